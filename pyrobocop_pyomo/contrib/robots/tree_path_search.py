"""Paths in any number of dimensions by two trees of random points that grow towards each other, and shortcuts of them.

References
----------
Kuffner, J. J., LaValle, S. M. (2000). RRT-Connect: an efficient approach to single-query path planning. Proceedings of
the IEEE International Conference on Robotics and Automation, 995-1001. https://doi.org/10.1109/ROBOT.2000.844730

Geraerts, R., Overmars, M. H. (2007). Creating high-quality paths for motion planning. The International Journal of
Robotics Research 26(8), 845-863. https://doi.org/10.1177/0278364907079280
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pyrobocop_pyomo.numerics import Array

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
    return _with_fewer_corners(path, are_clear, spacing)


def _with_fewer_corners(path: Array, are_clear: AreClear, spacing: float) -> Array:
    """Leave out corners one after the other, wherever the line past them is clear."""
    k = 1
    while k < len(path) - 1:
        if clear_length(path[k - 1], path[k + 1], are_clear, spacing) == 1.0:
            path, k = np.delete(path, k, axis=0), max(k - 1, 1)
        else:
            k += 1
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
