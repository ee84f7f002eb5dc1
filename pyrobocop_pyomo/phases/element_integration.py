"""One element integrated: explicit equations by SciPy, implicit and algebraic ones by the rows of the scheme.

With rows, the unknowns of an element are the states at its nodes, and the algebraics and the slopes of implicit states
at those of its stages that the element before does not share.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from pyrobocop_pyomo.complementarity import Complementarity
from pyrobocop_pyomo.errors import InitialGuessError, TrajectoryError, TranscriptionError
from pyrobocop_pyomo.modeling.lent_items import variables_read
from pyrobocop_pyomo.numerics import Array, Scheme
from pyrobocop_pyomo.numerics.flows import Flows
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.trajectories import Trajectory
from pyrobocop_pyomo.transcription import InitialGuess

from .declarations import Algebraic, Control
from .delays import AheadOfMotion, MotionSoFar, past_of
from .point_model import PointEquations, PointModel
from .quick_instants import SAMPLES
from .record import PhaseRecord

LOGGER = logging.getLogger(__name__)

# Relative to an element: shorter delays would take too many steps.
_SHORTEST_PART = 1e-5

# An explicit method that takes so many calls in one element is held back by stability: an implicit one goes on. Beyond
# the second number the motion is not known.
_MOST_CALLS, _MOST_CALLS_IF_STIFF = 1500, 30_000


class _TooStiff(Exception):
    """A method has taken its share of calls."""


Rates = Callable[[int, float, Array], Array]

# Steps of an element. Those of DOP853 have stages at most 0.27 of a step apart: less than a sixteenth of the element.
_FEWEST_STEPS = 5

# Relative to the size of the terms; hybr often stops above its own tolerance at a residual that is rounding.
_SOLVED = 1e-9


@dataclass(frozen=True)
class Unknowns:
    """What the equations at a collocation point determine.

    Attributes
    ----------
    implicit : tuple of str
        States whose derivatives stand in residual equations.
    algebraics : tuple of str
        Algebraics to find.
    order : tuple of str
        All algebraics and controls in the order of a trajectory.
    contact : bool
        Whether pairs determine some of it.
    """

    implicit: tuple[str, ...]
    algebraics: tuple[str, ...]
    order: tuple[str, ...]
    contact: bool = False


def find_unknowns(
    block: Any, record: PhaseRecord, given: Mapping[str, InitialGuess], asked: Sequence[str] | None = None
) -> Unknowns:
    """Tell what is to be found from what is given.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
    given : mapping of name to values
        Only the names count.
    asked : sequence of str, optional
        Algebraics and controls that are to be found; by default what equations and pairs suffice for: the algebraics
        that are not given and, where pairs then outnumber the unknowns, the controls that stand in pairs as well.

    Raises
    ------
    InitialGuessError
        When a name is unknown, or equations and unknowns do not match.
    """
    algebraics, controls = record.names(Algebraic), record.names(Control)
    for name in (*given, *(asked or ())):
        if name not in algebraics + controls:
            raise InitialGuessError(
                f"phase '{block.name}': '{name}' is given to a simulation, but it is neither control nor algebraic; "
                f"these are {', '.join(controls + algebraics) or 'none'}."
            )
    implicit = tuple(name for name in record.names_of_states if name not in record.equation_of)
    order = (*algebraics, *controls)
    equations, pairs = record.residuals_per_point - len(implicit), _pairs_per_point(block)
    if asked is not None:
        twice = [name for name in asked if name in given]
        if twice:
            raise InitialGuessError(f"phase '{block.name}': '{twice[0]}' is both given and to be found.")
        return Unknowns(implicit, tuple(asked), order, contact=pairs > 0)
    free = tuple(name for name in algebraics if name not in given)
    in_pairs = tuple(name for name in _controls_in_pairs(block, record, controls) if name not in given)
    for found in (free, (*free, *in_pairs)):
        if pairs and equations + pairs == len(found):
            return Unknowns(implicit, found, order, contact=True)
    if equations in (0, len(free)):  # without any, pairs alone would have to determine them: they keep their guess
        if pairs:
            LOGGER.info("phase '%s': the simulation looks at no pairs; they determine nothing in it.", block.name)
        return Unknowns(implicit, free if equations else (), order)
    raise InitialGuessError(
        f"phase '{block.name}': a simulation has {record.residuals_per_point} residual equations and {pairs} pairs per "
        f"point for {len(implicit) + len(free)} unknowns: {', '.join((*implicit, *free)) or 'none'}. Give in "
        "controls={...} what neither determines, or say by unknown=[...] what is to be found."
    )


def _pairs_per_point(block: Any) -> int:
    """How many pairs are stated at a collocation point."""
    counts = Counter(
        index[0] if isinstance(index, tuple) else index
        for component in block.component_objects(Complementarity, active=True, descend_into=False)
        for index, data in component.items()
        if data.active
    )
    return max(counts.values(), default=0)


def _controls_in_pairs(block: Any, record: PhaseRecord, controls: Sequence[str]) -> list[str]:
    """Controls that stand in a pair as they are, in the order of their declaration."""
    of = {id(variable): name for name in controls for variable in record.nodes(name).variables(block)}
    found = {
        of[id(variable)]
        for component in block.component_objects(Complementarity, active=True, descend_into=False)
        for data in component.values()
        if data.active
        for side in data.args
        for variable in variables_read(side)
        if id(variable) in of
    }
    return [name for name in controls if name in found]


def step_start(
    equations: PointEquations,
    times: tuple[float, ...],
    signals: dict[str, Array],
    rates: dict[str, Array],
    i: int,
    unknowns: Unknowns,
    start: Mapping[str, float],
    near: Mapping[str, float],
) -> float | None:
    """Find algebraics and slopes at the element start, where the states are known; None, or the residual left."""

    def residuals(guess: Array) -> Array:
        return _stage(equations, times[0], start, signals, rates, i, 0, unknowns, guess)

    guess = np.array([near[f"d {name}"] for name in unknowns.implicit] + [near[n] for n in unknowns.algebraics])
    left = _solve(residuals, guess)[1]
    return None if left <= _SOLVED else left


def step_element(
    equations: PointEquations,
    scheme: Scheme,
    width: float,
    times: tuple[float, ...],
    signals: dict[str, Array],
    rates: dict[str, Array],
    i: int,
    unknowns: Unknowns,
    start: Mapping[str, float],
    near: Mapping[str, float],
) -> dict[str, Array] | float:
    """Find everything on an element; returns the states at its nodes, or the residual left."""
    names, rows, stages = list(start), len(scheme.D), scheme.stages
    new = list(range(1 if scheme.starts_on_a_stage else 0, stages))
    first = 0 if scheme.starts_on_a_stage else 1
    per_stage = len(unknowns.implicit) + len(unknowns.algebraics)

    def nodes_of(guess: Array) -> dict[str, Array]:
        inner = guess[: rows * len(names)].reshape(len(names), rows)
        return {name: np.concatenate([[start[name]], inner[j]]) for j, name in enumerate(names)}

    def residuals(guess: Array) -> Array:
        nodes = nodes_of(guess)
        of_stages = guess[rows * len(names) :].reshape(len(new), per_stage)
        left = [
            _stage(
                equations, times[k], {name: float(nodes[name][first + k]) for name in names},
                signals, rates, i, k, unknowns, of_stages[j],
            )
            for j, k in enumerate(new)
        ]  # fmt: skip
        following = equations.next_states(times[-1], start)
        left += [
            nodes[name][-1:] - following[name]
            if name in following
            else scheme.D @ nodes[name] - width * (scheme.F @ rates[name][i])
            for name in names
        ]
        return np.concatenate(left) if left else np.empty(0)

    slopes = {
        name: float(rates[name][i, 0]) if scheme.starts_on_a_stage else near.get(f"d {name}", 0.0) for name in names
    }
    slopes = {name: slope if np.isfinite(slope) else 0.0 for name, slope in slopes.items()}  # of a step map: none
    guess = [start[name] + width * slopes[name] * tau for name in names for tau in scheme.state_nodes[1:]]
    guess += [near[key] for _ in new for key in (*(f"d {n}" for n in unknowns.implicit), *unknowns.algebraics)]
    found, left = _solve(residuals, np.array(guess, dtype=float))
    return nodes_of(found) if left <= _SOLVED else left


def _stage(
    equations: PointEquations,
    time: float,
    states: Mapping[str, float],
    signals: dict[str, Array],
    rates: dict[str, Array],
    i: int,
    k: int,
    unknowns: Unknowns,
    guess: Array,
) -> Array:
    """Residual equations at a stage; stores what was tried in signals and rates."""
    implicit, algebraics = unknowns.implicit, unknowns.algebraics
    for name, slope in zip(implicit, guess[: len(implicit)].tolist(), strict=True):
        rates[name][i, k] = slope
    for name, number in zip(algebraics, guess[len(implicit) :].tolist(), strict=True):
        signals[name][i, k] = number
    values = {**states, **{name: float(per_stage[i, k]) for name, per_stage in signals.items()}}
    slopes = {name: float(rates[name][i, k]) for name in implicit}
    explicit = equations.rates(time, values, slopes)
    for name, rate in explicit.items():
        rates[name][i, k] = rate
    return np.array(equations.residuals(time, {**slopes, **explicit}), dtype=float)


def _solve(residuals: Any, guess: Array) -> tuple[Array, float]:
    """The root next to an initial guess, and the largest residual there relative to the largest value."""
    if len(guess) == 0:
        residuals(guess)
        return guess, 0.0
    left = np.inf
    # MINPACK takes differences over a step relative to each value, and from a tiny value on they are rounding.
    guess = np.where(np.abs(guess) < 1e-6, 0.0, guess)
    for method in ("hybr", "lm"):
        result = scipy.optimize.root(residuals, guess, method=method, tol=1e-13)
        # Asked once more, since the last call of a method need not be at its result.
        left = float(np.abs(residuals(result.x)).max() / (1.0 + np.abs(result.x).max()))
        if left <= _SOLVED:
            break
    return result.x, left if np.isfinite(left) else np.inf


def signals_at(
    scheme: Scheme, local: float, time: float, per_stage: Mapping[str, Array], knots: Mapping[str, Array]
) -> dict[str, float]:
    """Algebraics and controls at one place of an element: stage polynomials, and lines between knots.

    Parameters
    ----------
    scheme : Scheme
    local : float
        From 0 to 1 within the element.
    time : float
        The same place, in the times of the knots.
    per_stage : mapping of name to array, shape (s,)
    knots : mapping of name to array, shape (2, knots)
        Times and values of the piecewise linear controls.
    """
    weights = scheme.stage_polynomial_at([local])[0]
    values = {name: float(weights @ stages) for name, stages in per_stage.items()}
    return values | {name: float(np.interp(time, *of_knots)) for name, of_knots in knots.items()}


def integrate_inside(
    trajectory: Trajectory, rates: Rates, fractions: Array, first: Array | None = None, delays: PointModel | None = None
) -> Flows:
    """Each element from its own start, and all of them from the first start on, by SciPy.

    Parameters
    ----------
    trajectory : Trajectory
    rates : callable
        ``rates(element, time, states)``
    fractions : array, shape (k,)
        Where in each element states are wanted, from 0 to 1.
    first : array, shape (n,), optional
        Where the whole motion starts; by default where the trajectory does.
    delays : PointModel, optional
        Where rules read earlier times: what they read belongs to the trajectory while each element is integrated from
        its own start, and to the motion itself when all of them are, by the method of steps.
    """
    boundaries = trajectory.grid.mesh.boundaries
    starts = np.array([trajectory.element_states(name)[:, 0] for name in trajectory.states]).T
    ends = list(enumerate(pairwise(boundaries)))
    local = [_integrate(rates, i, start, end, starts[i], fractions) for i, (start, end) in ends]
    if delays is not None:
        carried_on = _whole_by_steps(trajectory, rates, fractions, starts[0] if first is None else first, delays)
        return Flows(fractions, np.array(local), carried_on, 1e-10)
    whole: list[Array] = [local[0]] if first is None else [_integrate(rates, 0, *ends[0][1], first, fractions)]
    for i, (start, end) in ends[1:]:
        whole.append(_integrate(rates, i, start, end, whole[-1][-1], fractions))
    carried = np.array(whole)
    return Flows(fractions, np.array(local), carried if np.isfinite(carried).all() else None, 1e-10)


def _whole_by_steps(
    trajectory: Trajectory, rates: Rates, fractions: Array, state: Array, point: PointModel
) -> Array | None:
    """All elements from the first start on; None where that leaves the finite numbers."""
    of_plan = past_of(trajectory)
    point.past = so_far = MotionSoFar(list(trajectory.states), of_plan)
    carried = []
    try:
        for i, (start, end) in enumerate(pairwise(trajectory.grid.mesh.boundaries)):
            times = np.append(start + (end - start) * fractions[:-1], end)
            quick = len(times) > SAMPLES + 1
            for first, last in pairwise(times.tolist() if quick else [start, end]):
                with np.errstate(all="ignore"):
                    result = integrate_by_steps(
                        partial(rates, i), first, last, state, so_far, lambda: point.smallest_delay,
                        method="DOP853", rtol=1e-10, atol=1e-11,
                    )  # fmt: skip
                state = result.y[:, -1]
                if not result.success or not np.isfinite(state).all():
                    return None
            carried.append(np.array([so_far.state(time) for time in times.tolist()]))
    except (TrajectoryError, TranscriptionError):
        raise  # a rule that cannot be asked says nothing about the motion
    except (OverflowError, ZeroDivisionError, ValueError):
        return None
    finally:
        point.past = of_plan
    return np.array(carried)


def integrate_by_steps(
    rates: Callable[[float, Array], Array],
    start: float,
    end: float,
    state: Array,
    past: MotionSoFar,
    longest: Callable[[], float],
    *,
    to_real_time: Callable[[float], float] = float,
    **options: Any,
) -> Any:
    """Integrate by SciPy over parts so short that what is delayed is known; `past` learns each of them.

    Parameters
    ----------
    rates : callable
        ``rates(time, state)``; raises `AheadOfMotion` where a delayed value is not known yet.
    start, end : float
    state : array, shape (n,)
    past : MotionSoFar
    longest : callable
        How long a part may be, as far as is known after an attempt, in real time.
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
    step = min(end - start, longest() / unit)
    result = None
    while result is None or (result.success and result.t[-1] < end):
        first = start if result is None else float(result.t[-1])
        last = end if end - first < 1.001 * step else first + step
        try:
            result = scipy.integrate.solve_ivp(rates, (first, last), state, dense_output=True, **options)
        except AheadOfMotion:
            step = min(0.5 * step, longest() / unit)
            if step < _SHORTEST_PART * (end - start):
                raise TrajectoryError(
                    f"a delay is shorter than {_SHORTEST_PART:g} of the element that starts at {first:g}: the method "
                    "of steps does not get on."
                ) from None
            continue
        if result.success:
            state = result.y[:, -1]
            past.append(to_real_time(last), partial(_at_real_time, result.sol, to_real_time(start), start, unit))
    return result


def _at_real_time(solution: Callable[[float], Array], origin: float, start: float, unit: float, time: float) -> Array:
    return solution(start + (time - origin) / unit)


def _integrate(rates: Rates, i: int, start: float, end: float, initial: Array, fractions: Array) -> Array:
    """States at the fractions of an element; infinite where they are not known.

    An integration that has to end at each fraction cannot step over what happens between two of them.
    """
    times = np.append(start + (end - start) * fractions[:-1], end)
    if len(times) <= SAMPLES + 1:
        return _integrate_part(rates, i, initial, times)
    states = [initial]
    for part in pairwise(times.tolist()):
        states.append(_integrate_part(rates, i, states[-1], np.array(part))[-1])
    return np.array(states)


def _integrate_part(rates: Rates, i: int, initial: Array, times: Array) -> Array:
    nothing = np.full((len(times), len(initial)), np.inf)
    if not np.isfinite(initial).all():
        return nothing
    start, end = float(times[0]), float(times[-1])
    if start == end:
        return np.repeat(initial[None], len(times), axis=0)
    for method, most in (("DOP853", _MOST_CALLS), ("Radau", _MOST_CALLS_IF_STIFF)):
        calls = 0

        def counted(t: float, x: Array, most: int = most) -> Array:
            nonlocal calls
            calls += 1
            if calls > most:
                raise _TooStiff
            return rates(i, t, x)

        # A few long steps: where elements are many they are short, and these are mostly accepted. What they are worth
        # is controlled as ever; with fewer, rules that change for a while only would be looked at too seldom.
        longest = (end - start) / (_FEWEST_STEPS if len(times) > 2 else 1)
        first_step = longest if method == "DOP853" else None
        try:
            with np.errstate(all="ignore"):  # an unstable motion may overflow on its way to the remark about it
                result = scipy.integrate.solve_ivp(
                    counted, (start, end), initial, method=method, rtol=1e-10, atol=1e-11, first_step=first_step,
                    max_step=longest, t_eval=times,
                )  # fmt: skip
        except _TooStiff:
            continue
        except (TrajectoryError, TranscriptionError):
            raise  # a rule that cannot be asked says nothing about the motion
        except (OverflowError, ZeroDivisionError, ValueError):
            return nothing
        return result.y.T if result.success and len(result.t) == len(times) else nothing
    return nothing
