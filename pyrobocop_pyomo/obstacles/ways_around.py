"""A way for a convex body between all obstacles at once, whatever it turns by: a guess where the user's leads through.

Each pair of shapes that overlap has its own cheapest way out, and those of several obstacles may contradict each other:
left of one, right of the next, where the gap is above both. A search over a grid sees all of them together.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.optional_imports import scipy

Array = NDArray[np.float64]

MOST_CELLS = 100_000
# What a cell costs where the body fits only if it is turned the right way; 1 where it fits in any way.
NARROW = 3.0
BLOCKED = 1e4


@dataclass(frozen=True)
class Core:
    """The balls inside and around a shape, about one point of it.

    Attributes
    ----------
    middle : (d,) array
        In the frame of the shape.
    inner, outer : float
        Radii, the padding included. The inner ball is inside, the outer one contains the shape.
    """

    middle: Array
    inner: float
    outer: float

    @classmethod
    def of(cls, shape: Polytope) -> Core:
        """About the mean of the vertices."""
        middle = shape.vertices.mean(axis=0)
        inner = 0.0
        if not shape.is_flat:
            normals, offsets = shape.halfspaces
            inner = float((offsets - normals @ middle).min())
        outer = float(np.linalg.norm(shape.vertices - middle, axis=1).max())
        return cls(middle, max(inner, 0.0) + shape.radius, outer + shape.radius)


def way_around(
    start: Array, goal: Array, core: Core, obstacles: Sequence[Polytope], clearance: float, low: Array, high: Array
) -> Array | None:
    """Shortest way on a grid for the inner ball of a body, with a preference for where the outer one fits.

    Parameters
    ----------
    start, goal : (d,) array
        Of the body's middle.
    core : Core
    obstacles : sequence of Polytope
        Placed in the world.
    clearance : float
        To be kept by the inner ball, so that a body that fits finds its way.
    low, high : (d,) array
        Corners of the region that is searched; start and goal are inside.

    Returns
    -------
    (k, d) array, or None
        Points from start to goal; None where there is no way on this grid.

    Notes
    -----
    Distances are those to the facets' planes and to the box around each obstacle, whichever is larger: never more than
    the true ones. Cells are taken to be blocked within half of their diagonal, so that no wall is stepped through.
    """
    size = np.maximum(high - low, 1e-9)
    finest = max(core.inner + clearance, 1e-3 * float(size.max()))
    cell = max(finest / np.sqrt(len(size)), float((size.prod() / MOST_CELLS) ** (1 / len(size))))
    counts = np.maximum(np.ceil(size / cell).astype(int), 1) + 1
    axes = [np.linspace(a, b, n) for a, b, n in zip(low, high, counts, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(size))
    distance = lower_distances(points, obstacles)
    needed = max(core.inner + clearance, 0.5 * cell * np.sqrt(len(size)))
    comfort = max(core.outer + clearance, needed + cell)
    cost = 1.0 + NARROW * np.clip((comfort - distance) / (comfort - needed), 0.0, 1.0)
    cost[distance < needed] = BLOCKED
    ends = [int(((points - each) ** 2).sum(axis=1).argmin()) for each in (start, goal)]
    cells = _cheapest(cost, points, counts, *ends)
    way = points[cells]
    # The ends of the guess may be in places too tight for the grid. Elsewhere it does not help to pass through a wall.
    far = np.minimum(*(np.linalg.norm(way - each, axis=1) for each in (start, goal))) > core.outer + cell
    if (cost[cells] >= BLOCKED)[far].any():
        return None
    return np.vstack([start, way[1:-1], goal])


def lower_distances(points: Array, obstacles: Sequence[Polytope]) -> Array:
    """Lower bounds (k,) of the distances of points (k, d) to the nearest of the obstacles."""
    found = np.full(len(points), np.inf)
    for each in obstacles:
        bound = np.full(len(points), -np.inf)
        if not each.is_flat:
            normals, offsets = each.halfspaces
            bound = np.maximum(bound, (points @ normals.T - offsets).max(axis=1))
        if each.is_bounded:
            below, above = each.vertices.min(axis=0), each.vertices.max(axis=0)
            outside = np.maximum(below - points, points - above)
            bound = np.maximum(bound, np.where(outside.max(axis=1) > 0, np.linalg.norm(outside.clip(0), axis=1), bound))
        found = np.minimum(found, bound - each.radius)
    return found


def _cheapest(cost: Array, points: Array, counts: NDArray[np.int64], start: int, goal: int) -> NDArray[np.int64]:
    """Cells of the cheapest path between two cells, from each to its neighbours across faces, edges and corners."""
    numbers = np.arange(len(points)).reshape(counts)
    origins, targets, weights = [], [], []
    for step in itertools.product((-1, 0, 1), repeat=len(counts)):
        if step <= (0,) * len(counts):
            continue  # the other half of the neighbours are these, seen from the other end
        here = numbers[tuple(slice(max(0, -d), n - max(0, d)) for d, n in zip(step, counts, strict=True))].ravel()
        there = numbers[tuple(slice(max(0, d), n - max(0, -d)) for d, n in zip(step, counts, strict=True))].ravel()
        origins.append(here)
        targets.append(there)
        length = np.linalg.norm(points[there] - points[here], axis=1)
        weights.append(length * 0.5 * (cost[here] + cost[there]))
    graph = scipy.sparse.coo_array(
        (np.concatenate(weights), (np.concatenate(origins), np.concatenate(targets))), shape=(len(points),) * 2
    )
    _, before = scipy.sparse.csgraph.dijkstra(graph.tocsr(), directed=False, indices=start, return_predecessors=True)
    path = [goal]
    while path[-1] != start:
        path.append(int(before[path[-1]]))
    return np.array(path[::-1])
