"""One element after the other integrated by SciPy with delays, by the method of steps."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ModelError, TrajectoryError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.trajectories import Trajectory

from .delays import MotionSoFar, past_of
from .rate_arrays import PointRates

# Relative to an element: shorter delays would take too many steps.
_SHORTEST_PART = 1e-5
_EXACTLY: dict[str, Any] = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-11}


def whole_by_steps(
    trajectory: Trajectory, rates: PointRates, parts: Array, fractions: Array, state: Array
) -> Array | None:
    """All elements from the first start on, where what rules read at earlier times belongs to that motion.

    Parameters
    ----------
    trajectory : Trajectory
    rates : PointRates
        Whose past is that motion meanwhile.
    parts : array
        Of an element, from 0 to 1, that no step goes across.
    fractions : array, shape (k,)
        Where in each element states are wanted.
    state : array, shape (n,)
        Where the motion starts.

    Returns
    -------
    array, shape (N, k, n), or None
        None where the motion leaves the finite numbers.
    """
    start = trajectory.grid.mesh.boundaries[0]
    rates.past = so_far = MotionSoFar(list(trajectory.states), past_of(trajectory), start, state)
    carried = []
    try:
        for i, (start, end) in enumerate(pairwise(trajectory.grid.mesh.boundaries)):
            times = np.append(start + (end - start) * fractions[:-1], end)
            for first, last in pairwise([*(start + (end - start) * parts[:-1]).tolist(), end]):
                with np.errstate(all="ignore"):
                    result = integrate_by_steps(
                        _by_time(trajectory, rates, i), first, last, state, so_far, rates.smallest_delay,
                        **_EXACTLY,
                    )  # fmt: skip
                state = result.y[:, -1]
                if not result.success or not np.isfinite(state).all():
                    return None
            carried.append(np.array([so_far.state(time) for time in times.tolist()]))
    except (TrajectoryError, ModelError):
        raise  # a rule that cannot be asked says nothing about the motion
    except (OverflowError, ZeroDivisionError, ValueError):
        return None
    return np.array(carried)


def each_from_its_start(
    trajectory: Trajectory, rates: PointRates, parts: Array, fractions: Array, starts: Array
) -> Array:
    """Each element from its own start, where earlier times are those of the trajectory; infinite where it has no end.

    What is delayed may jump inside an element, at another place in each: steps have to be chosen one by one.

    Parameters
    ----------
    trajectory, rates, parts, fractions
        As for `whole_by_steps`.
    starts : array, shape (N, n)

    Returns
    -------
    array, shape (N, k, n)
    """
    rates.past = past_of(trajectory)
    found = np.full((len(starts), len(fractions), starts.shape[1]), np.inf)
    for i, (start, end) in enumerate(pairwise(trajectory.grid.mesh.boundaries)):
        state, by_time = starts[i], _by_time(trajectory, rates, i)
        for before, after in pairwise(parts.tolist()):
            inside = (fractions >= before) & (fractions <= after)
            times = np.clip(start + (end - start) * fractions[inside], start, end)
            ends = (start + (end - start) * before, end if after == 1.0 else start + (end - start) * after)
            with np.errstate(all="ignore"):
                result = scipy.integrate.solve_ivp(by_time, ends, state, dense_output=True, **_EXACTLY)
            state = result.y[:, -1]
            if not result.success or not np.isfinite(state).all():
                break
            found[i, inside] = result.sol(times).T
    return found


def _by_time(trajectory: Trajectory, rates: PointRates, i: int) -> Callable[[float, Array], Array]:
    start, width = trajectory.grid.mesh.boundaries[i], trajectory.grid.mesh.widths[i]
    return lambda time, state: rates(i, (time - start) / width, state)


def integrate_by_steps(
    rates: Callable[[float, Array], Array],
    start: float,
    end: float,
    state: Array,
    past: MotionSoFar,
    longest: float,
    *,
    to_real_time: Callable[[float], float] = float,
    **options: Any,
) -> Any:
    """Integrate by SciPy over parts so short that what is delayed is known; `past` learns each of them.

    Parameters
    ----------
    rates : callable
        ``rates(time, state)``
    start, end : float
    state : array, shape (n,)
    past : MotionSoFar
    longest : float
        How long a part may be, in real time.
    to_real_time : callable
        From the times of the integration, linear.
    **options
        Of `scipy.integrate.solve_ivp`.

    Returns
    -------
    OdeResult
        Of the last part; of the one that failed, where ``success`` is False.

    Raises
    ------
    TrajectoryError
        When a delay is too short to go on.
    """
    unit = (to_real_time(end) - to_real_time(start)) / (end - start)
    step = min(end - start, longest / unit)
    if step < _SHORTEST_PART * (end - start):
        raise TrajectoryError(
            f"a delay is shorter than {_SHORTEST_PART:g} of the element that starts at {start:g}: the method of steps "
            "does not get on."
        )
    result = None
    while result is None or (result.success and result.t[-1] < end):
        first = start if result is None else float(result.t[-1])
        last = end if end - first < 1.001 * step else first + step
        result = scipy.integrate.solve_ivp(rates, (first, last), state, dense_output=True, **options)
        if result.success:
            state = result.y[:, -1]
            past.append(to_real_time(last), partial(_at_real_time, result.sol, to_real_time(start), start, unit))
    return result


def _at_real_time(solution: Callable[[float], Array], origin: float, start: float, unit: float, time: float) -> Array:
    return solution(start + (time - origin) / unit)
