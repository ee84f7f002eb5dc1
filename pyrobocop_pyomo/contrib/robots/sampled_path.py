"""`sampled_path`: an initial guess for arms and bodies that fly freely, along a path among random configurations.

Paths in any number of dimensions by two trees of random points that grow towards each other, and shortcuts of them.

References
----------
Kuffner, J. J., LaValle, S. M. (2000). RRT-Connect: an efficient approach to single-query path planning. Proceedings of
the IEEE International Conference on Robotics and Automation, 995-1001. https://doi.org/10.1109/ROBOT.2000.844730

Geraerts, R., Overmars, M. H. (2007). Creating high-quality paths for motion planning. The International Journal of
Robotics Research 26(8), 845-863. https://doi.org/10.1177/0278364907079280
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases.horizon import horizon_fraction

from .configuration_space import ConfigurationSpace

# ----------------------------------------------------------------------------------------------------------- the search


AreClear = Callable[[Array], Array]

# The longest branch, in diagonals of the box.
LONGEST_BRANCH = 0.1


def tree_path(
    starts: Array, goals: Array, box: tuple[Array, Array], are_clear: AreClear, *, spacing: float, samples: int,
    generator: np.random.Generator,
) -> tuple[Array | None, int]:  # fmt: skip
    """A path of straight lines from one of the starts to one of the goals, on which all points looked at are clear.

    Parameters
    ----------
    starts : (s, n) array
    goals : (g, n) array
        All of them clear.
    box : two (n,) arrays
        Corners of the box that is sampled. A unit of each coordinate has to matter about as much.
    are_clear : callable
        Of points (k, n), which of them (k,) are clear.
    spacing : float
        Between the points of a line that are looked at.
    samples : int
        Most random points.
    generator : numpy.random.Generator

    Returns
    -------
    path : (k, n) array, or None
        Its corners.
    samples : int
        How many were taken.
    """
    low, high = box
    longest = max(LONGEST_BRANCH * float(np.linalg.norm(high - low)), 2.0 * spacing)
    trees = [_Tree(starts), _Tree(goals)]
    for count in range(1, samples + 1):
        growing, other = trees if count % 2 else trees[::-1]
        node = growing.grown(generator.uniform(low, high), are_clear, spacing, longest)
        if node is None:
            continue
        met = other.grown(growing.points[node], are_clear, spacing, np.inf)
        if met is not None and np.array_equal(other.points[met], growing.points[node]):
            from_start, from_goal = (growing, node), (other, met)
            if not count % 2:
                from_start, from_goal = from_goal, from_start
            there, back = from_start[0].branch(from_start[1]), from_goal[0].branch(from_goal[1])
            return np.vstack([there[::-1], back[1:]]), count
    return None, samples


def shortened(path: Array, are_clear: AreClear, *, spacing: float, tries: int, generator: np.random.Generator) -> Array:
    """Corners of a shorter path, by lines between random pairs of its points that are clear.

    Parameters
    ----------
    path : (k, n) array
    are_clear : callable
    spacing : float
    tries : int
    generator : numpy.random.Generator
    """
    for _ in range(tries):
        lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
        passed = np.concatenate([[0.0], np.cumsum(lengths)])
        if len(path) < 3 or passed[-1] == 0.0:
            return path
        first, last = np.sort(generator.uniform(0.0, passed[-1], 2))
        i, j = (int(np.searchsorted(passed[1:-1], at, side="right")) + 1 for at in (first, last))
        if i == j:
            continue
        a, b = (np.array([np.interp(at, passed, column) for column in path.T]) for at in (first, last))
        if clear_length(a, b, are_clear, spacing) == 1.0:
            path = np.vstack([path[:i], a, b, path[j:]])
    return path


def clear_length(start: Array, end: Array, are_clear: AreClear, spacing: float) -> float:
    """The share of a line that is clear from its start on, the start itself not looked at; 1 where all of it is."""
    count = max(int(np.ceil(np.linalg.norm(end - start) / spacing)), 1)
    shares = np.arange(1, count + 1) / count
    clear = are_clear(start + shares[:, None] * (end - start))
    return 1.0 if clear.all() else int(np.argmin(clear)) / count


class _Tree:
    """Points, each with the one it was reached from; roots have -1."""

    def __init__(self, roots: Array) -> None:
        self._count = len(roots)
        self._points = np.array(roots, dtype=float)
        self._parents = [-1] * len(roots)

    @property
    def points(self) -> Array:
        return self._points[: self._count]

    def grown(self, target: Array, are_clear: AreClear, spacing: float, longest: float) -> int | None:
        """Number of the new point towards a target, or of the target itself; None where the way is blocked at once."""
        near = int(np.square(self.points - target).sum(axis=1).argmin())
        start = self.points[near].copy()
        distance = float(np.linalg.norm(target - start))
        if distance == 0.0:
            return near
        reaches = distance <= longest
        end = target if reaches else start + longest / distance * (target - start)
        share = clear_length(start, end, are_clear, spacing)
        if share == 0.0:
            return None
        return self._add(end.copy() if share == 1.0 else start + share * (end - start), near)

    def _add(self, point: Array, parent: int) -> int:
        if self._count == len(self._points):
            self._points = np.vstack([self._points, np.empty_like(self._points), np.empty((64, len(point)))])
        self._points[self._count] = point
        self._parents.append(parent)
        self._count += 1
        return self._count - 1

    def branch(self, node: int) -> Array:
        """Points from one of them back to its root."""
        way = []
        while node >= 0:
            way.append(self._points[node])
            node = self._parents[node]
        return np.array(way)


# --------------------------------------------------------------------------------------------------------------- robots


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
    space.require_clearances(clearances, np.vstack([starts, goals]))
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
    return functions_of_time_index(phase, dict(zip(space.names, columns, strict=True)))


def functions_of_time_index(phase: Any, columns: Mapping[str, Array]) -> dict[str, Callable[[float], float]]:
    """Columns at equal distances in the time of a phase as functions of its time index, by name."""
    fraction = horizon_fraction(phase)

    def course(column: Array) -> Callable[[float], float]:
        shares = np.linspace(0.0, 1.0, len(column))
        return lambda t: float(np.interp(fraction(t), shares, column))

    return {name: course(column) for name, column in columns.items()}
