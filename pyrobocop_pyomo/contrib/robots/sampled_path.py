"""`sampled_path`: an initial guess for arms and bodies that fly freely, along a path among random configurations."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.contrib.robots.inverse_dynamics import InverseDynamics
from pyrobocop_pyomo.errors import InitialGuessError, PyRobocopError
from pyrobocop_pyomo.modeling.variable_values import within_bounds
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases.horizon import horizon_fraction

from .configuration_space import ConfigurationSpace
from .tree_path_search import clear_length, shortened, tree_path

logger = logging.getLogger(__name__)

SHORTCUTS = 150
# Share of a path over which its corners are rounded; halved so often until the rounded path is clear.
ROUNDED, HALVED = 0.2, 3
FINE = 400
# Durations are a little longer than bounds of speeds ask for.
MARGIN = 1.1


def sampled_path(
    phase: Any, *, clearances: float = 1.0, samples: int = 4000, seed: int = 0
) -> dict[str, Callable[[float], float] | float]:
    """Initial guess along a path that is clear of obstacles, for ``phase.initialize``; for arms, and bodies that fly.

    Parameters
    ----------
    phase : PhaseBlock
        With an `ObstacleAvoidanceBlock` and an initial guess, such as ``phase.initialize_straight_lines()``. The path
        leads from the fixed initial values of the states that poses read to their fixed final values. Where these are
        not fixed, rows of the model that read these states at the end, and nothing else that is free, are solved for
        them: inverse kinematics, of which the solutions nearest to the start are tried. Bounds of the states are kept.
    clearances : float
        How many of them the path keeps; less where its ends have less room.
    samples : int
        Most random configurations.
    seed : int
        The same seed gives the same path.

    Returns
    -------
    dict of str to function of the time index, or float
        The states that poses read; what drives them, as far as the differential equations say it; and the duration
        where it is free and the path takes longer than the present one.

    Raises
    ------
    InitialGuessError
        When no path was found, with the number of samples; when no clear start or end was found; or when no pose reads
        a state.

    Notes
    -----
    RRT-Connect, then shortcuts, then rounded corners. Distances are exact, at configurations so close that no shape of
    the scene is passed through in between. What moves by itself is not looked at, nor are equations that let a body
    move in some directions only: for cars there is `hybrid_a_star`.

    Examples
    --------
    ::

        arm.initialize_straight_lines()
        arm.initialize(rcp.scenes.sampled_path(arm))
    """
    space = ConfigurationSpace(phase)
    generator = np.random.default_rng(seed)
    starts = space.ends(False, space.guess()[-1], generator)
    goals = space.ends(True, starts[0], generator)
    space.ask_for(clearances, np.vstack([starts, goals]))
    lengths = space.lengths

    def are_clear(points: Array) -> Any:
        return space.are_clear(points / lengths)

    path, used = tree_path(
        starts * lengths, goals * lengths, (space.low * lengths, space.high * lengths), are_clear,
        spacing=space.spacing, samples=samples, generator=generator,
    )  # fmt: skip
    if path is None:
        raise InitialGuessError(
            f"{space.label}: no path from the start to the end was found among {samples} random configurations of "
            f"{', '.join(space.names)}; there may be none. Check the obstacles, the clearance and both ends, or start "
            "from waypoints (rcp.scenes.waypoint_initial_guess) or by sampled_path(samples=...)."
        )
    path = shortened(path, are_clear, spacing=space.spacing, tries=SHORTCUTS, generator=generator)
    logger.info("%s: a path of %d lines after %d samples.", space.label, len(path) - 1, used)
    return _timed(phase, space, _rounded(path, are_clear, space.spacing) / lengths)


def _rounded(path: Array, are_clear: Callable[[Array], Any], spacing: float) -> Array:
    """Points of a path at equal distances, its corners rounded as far as that is clear."""
    passed = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    even = np.linspace(0.0, passed[-1], FINE + 1)
    line = np.column_stack([np.interp(even, passed, column) for column in path.T])
    width = int(ROUNDED * FINE) // 2
    for _ in range(HALVED):
        padded = np.vstack([_beyond(line[width:0:-1], line[0]), line, _beyond(line[-2 : -width - 2 : -1], line[-1])])
        window = np.ones(2 * width + 1) / (2 * width + 1)
        smooth = np.column_stack([np.convolve(column, window, mode="valid") for column in padded.T])
        if all(clear_length(a, b, are_clear, spacing) == 1.0 for a, b in zip(smooth[:-1:5], smooth[5::5], strict=True)):
            return smooth
        width //= 2
    return line


def _beyond(points: Array, end: Array) -> Array:
    """Points mirrored at an end, which stays where it is when means are taken across it."""
    return np.asarray(2.0 * end - points)


def _timed(phase: Any, space: ConfigurationSpace, path: Array) -> dict[str, Callable[[float], float] | float]:
    """The path over the duration of the phase, with what drives it; smooth at both ends where speeds are states."""
    shares = np.linspace(0.0, 1.0, len(path))
    duration = float(value(phase.duration))
    further: dict[str, Callable[[float], float] | float] = {}
    columns = dict(zip(space.names, path.T, strict=True))
    try:
        rates = InverseDynamics(phase)
        driven = [name for name in space.names if name in rates.rates]
        if any(name in rates.rates for name in rates.inputs(driven)):
            covered = shares**2 * (3.0 - 2.0 * shares)
            columns = {name: np.interp(covered, shares, column) for name, column in columns.items()}
        slopes = {name: np.gradient(columns[name], shares) for name in driven}
        free = phase.component("duration")
        if free is not None and free.ctype is Var and not free.fixed:
            duration = within_bounds(max(duration, _least_duration(rates, driven, slopes)), free)
            further["duration"] = duration
        wanted = np.column_stack([slopes[name] for name in driven]) / duration
        columns = rates.driven(driven, columns, wanted, shares * duration)
    except (PyRobocopError, KeyError, TypeError, ValueError, np.linalg.LinAlgError) as error:
        # Equations that are implicit, or read what is no function of time: the path is a guess without controls too.
        logger.info("%s: what drives the path is not known: %s", space.label, error)
    return courses(phase, columns) | further


def courses(phase: Any, columns: Mapping[str, Array]) -> dict[str, Callable[[float], float] | float]:
    """Columns at equal distances in the time of a phase as functions of its time index, by name."""
    fraction = horizon_fraction(phase)

    def course(column: Array) -> Callable[[float], float]:
        shares = np.linspace(0.0, 1.0, len(column))
        return lambda t: float(np.interp(fraction(t), shares, column))

    return {name: course(column) for name, column in columns.items()}


def _least_duration(rates: InverseDynamics, names: list[str], slopes: dict[str, Array]) -> float:
    """How long the path takes where bounds of what drives a state say how fast it is."""
    least = 0.0
    values = rates.sampled(names, np.random.default_rng(0))
    for name in names:
        inputs = rates.inputs([name])
        if inputs and all(None not in rates.variables[each].bounds for each in inputs):
            fastest = float(np.abs(rates.evaluated([rates.rates[name]], values, len(values[name]))).max())
            least = max(least, MARGIN * float(np.abs(slopes[name]).max()) / fastest if fastest > 0.0 else math.inf)
    return least if math.isfinite(least) else 0.0
