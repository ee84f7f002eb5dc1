"""`waypoint_initial_guess`: an initial guess on straight lines through waypoints, at constant speed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.numerics.arrays import finite_numbers

from .horizon import horizon_fraction


def waypoint_initial_guess(
    phase: Any, waypoints: Mapping[Any, Sequence[float]], *, even_in: Iterable[Any] | None = None
) -> dict[str, Callable[[float], float]]:
    """Initial guess of states on straight lines through waypoints, for ``phase.initialize``.

    Parameters
    ----------
    phase : PhaseBlock
    waypoints : dict of str or Var to list of float
        Values of each state at all waypoints, the first at the start of the phase and the last at its end. Two or more
        values, the same number for every state.
    even_in : list of str or Var, optional
        States in whose space the speed is constant. They need the same unit: positions, for example, but not angles.
        All states by default.

    Returns
    -------
    dict of str to function
        Of the time index.

    Raises
    ------
    InitialGuessError
        When names, lengths or values do not fit.

    Examples
    --------
    ::

        waypoints = {"x": [0, 2, 4], "y": [0, 1, 0], "theta": [0, 0, 1]}
        phase.initialize(rcp.scenes.waypoint_initial_guess(phase, waypoints, even_in="xy"))
    """
    fraction = horizon_fraction(phase)
    names = [_name(phase, key) for key in waypoints]
    lines = finite_numbers(list(waypoints.values()), f"phase '{phase.name}': waypoints", InitialGuessError)
    if lines.ndim != 2 or lines.shape[1] < 2:
        raise InitialGuessError(
            f"phase '{phase.name}': waypoints of the shape {lines.shape}; expected one list per state, all of one "
            "length, two values or more: {'x': [0, 1, 2], ...}."
        )
    values = dict(zip(names, lines, strict=True))
    counted = list(values) if even_in is None else [_name(phase, key) for key in even_in]
    if not counted or set(counted) - set(values):
        raise InitialGuessError(
            f"phase '{phase.name}': even_in has {', '.join(counted) or 'nothing'}; waypoints are given for "
            f"{', '.join(values)}. Name one or more of these."
        )
    lengths = np.sqrt(sum(np.diff(values[name]) ** 2 for name in counted))
    if lengths.sum() == 0.0:
        lengths = np.ones_like(lengths)  # only other states change: equal time for every line
    reached = np.concatenate([[0.0], np.cumsum(lengths)]) / lengths.sum()
    return {name: _along(reached, numbers, fraction) for name, numbers in values.items()}


def _along(reached: np.ndarray, values: np.ndarray, fraction: Callable[[float], float]) -> Callable[[float], float]:
    return lambda t: float(np.interp(fraction(t), reached, values))


def _name(phase: Any, key: Any) -> str:
    name = key if isinstance(key, str) else getattr(key, "local_name", None) or repr(key)
    if phase.component(name) is None or not (isinstance(key, str) or phase.component(name) is key):
        raise InitialGuessError(f"phase '{phase.name}': waypoints are given for '{name}', which it does not have.")
    return name
