"""`sampled_path`: an initial guess for arms and bodies that fly freely, along a path among random configurations."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases.horizon import horizon_fraction

from .configuration_space import ConfigurationSpace
from .tree_path_search import shortened, tree_path

logger = logging.getLogger(__name__)

SHORTCUTS = 150
FINE = 400


def sampled_path(
    phase: Any, *, clearances: float = 1.0, samples: int = 4000, seed: int = 0
) -> dict[str, Callable[[float], float]]:
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
    dict of str to function of the time index
        The states that poses read, at an even pace.

    Raises
    ------
    InitialGuessError
        When no path was found, with the number of samples; when no clear start or end was found; or when no pose reads
        a state.

    Notes
    -----
    RRT-Connect, then shortcuts. Distances are exact, at configurations so close that no shape of
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
    passed = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    even = np.linspace(0.0, passed[-1], FINE + 1)
    columns = [np.interp(even, passed, column) for column in (path / lengths).T]
    return courses(phase, dict(zip(space.names, columns, strict=True)))


def courses(phase: Any, columns: Mapping[str, Array]) -> dict[str, Callable[[float], float]]:
    """Columns at equal distances in the time of a phase as functions of its time index, by name."""
    fraction = horizon_fraction(phase)

    def course(column: Array) -> Callable[[float], float]:
        shares = np.linspace(0.0, 1.0, len(column))
        return lambda t: float(np.interp(fraction(t), shares, column))

    return {name: course(column) for name, column in columns.items()}
