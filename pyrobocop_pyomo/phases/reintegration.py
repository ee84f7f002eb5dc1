"""Integrating a trajectory's elements anew, by SciPy, with its own controls and algebraics."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.trajectories import Trajectory

Array = NDArray[np.float64]
Rates = Callable[[int, float, Array], Array]


def integrate_elements(trajectory: Trajectory, rates: Rates) -> Array:
    """Each element from its own start: differences at the ends, shape ``(N, states)``."""
    boundaries = trajectory.grid.mesh.boundaries
    values = _at_boundaries(trajectory)
    ends = [_integrate(rates, i, start, end, values[i]) for i, (start, end) in enumerate(pairwise(boundaries))]
    return np.array(ends) - values[1:]


def integrate_horizon(trajectory: Trajectory, rates: Rates) -> Array:
    """The whole horizon in one go: differences at element ends, shape ``(N, states)``."""
    boundaries = trajectory.grid.mesh.boundaries
    values = _at_boundaries(trajectory)
    carried, ends = values[0], []
    for i, (start, end) in enumerate(pairwise(boundaries)):
        carried = _integrate(rates, i, start, end, carried)
        ends.append(carried)
    return np.array(ends) - values[1:]


def _at_boundaries(trajectory: Trajectory) -> Array:
    columns = [
        [*trajectory.element_states(name)[:, 0].tolist(), float(trajectory.states[name][-1])]
        for name in trajectory.states
    ]
    return np.array(columns).T


def _integrate(rates: Rates, i: int, start: float, end: float, initial: Array) -> Array:
    if not np.isfinite(initial).all():
        return np.full_like(initial, np.inf)
    try:
        with np.errstate(all="ignore"):  # an unstable motion may overflow on its way to the remark about it
            answer = scipy.integrate.solve_ivp(
                lambda t, x: rates(i, t, x), (start, end), initial, method="DOP853", rtol=1e-10, atol=1e-11
            )
    except TrajectoryError:
        raise  # a rule that cannot be asked says nothing about the motion
    except (OverflowError, ZeroDivisionError, ValueError):
        return np.full_like(initial, np.inf)
    return answer.y[:, -1] if answer.success else np.full_like(initial, np.inf)
