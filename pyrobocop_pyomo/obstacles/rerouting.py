"""Rerouting of an initial guess: along a grid path that leads a convex body around all obstacles at once.

Every pair of shapes that overlap has its own cheapest separation, and the separations of several obstacles may
contradict each other: left of one, right of the next, where the gap is above both. A search on a grid sees all of them
together.

Shortest paths on grids in any dimension, by Dijkstra's method over faces, edges and corners of the cells.
"""

from __future__ import annotations

import itertools
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.geometry.poses import is_number
from pyrobocop_pyomo.modeling.variable_values import within_bounds
from pyrobocop_pyomo.motion.bodies import Body
from pyrobocop_pyomo.numerics import Array, Indices
from pyrobocop_pyomo.optional_imports import scipy

from .scene import Scene

# ------------------------------------------------------------------------------------------------------ paths on a grid


def grid_distances(cost: Array, spacing: Array, start: tuple[int, ...]) -> Array:
    """Length of the shortest path from one cell to every cell.

    Parameters
    ----------
    cost : (n_1, ..., n_d) array
        Factor of lengths in each cell; infinite where nothing may pass.
    spacing : (d,) array
        From one cell to the next, along each axis.
    start : d integers

    Returns
    -------
    (n_1, ..., n_d) array
        Infinite where no path leads.
    """
    numbers = np.arange(cost.size).reshape(cost.shape)
    found = scipy.sparse.csgraph.dijkstra(_graph(cost, spacing), directed=False, indices=numbers[start])
    return np.asarray(found).reshape(cost.shape)


def grid_path(cost: Array, spacing: Array, start: tuple[int, ...], goal: tuple[int, ...]) -> Indices | None:
    """Cells (k, d) of the shortest path from start to goal, see `grid_distances`; None if there is none."""
    numbers = np.arange(cost.size).reshape(cost.shape)
    _, before = scipy.sparse.csgraph.dijkstra(
        _graph(cost, spacing), directed=False, indices=numbers[start], return_predecessors=True
    )
    cells = [int(numbers[goal])]
    while cells[-1] != numbers[start]:
        cells.append(int(before[cells[-1]]))
        if cells[-1] < 0:
            return None
    return np.column_stack(np.unravel_index(cells[::-1], cost.shape))


def _graph(cost: Array, spacing: Array) -> scipy.sparse.csr_array:
    numbers = np.arange(cost.size, dtype=np.int32).reshape(cost.shape)  # SciPy 1.14 searches no graph of larger ones
    origins, targets, lengths = [], [], []
    for step in itertools.product((-1, 0, 1), repeat=cost.ndim):
        if step <= (0,) * cost.ndim:
            continue  # the other half of the neighbours are these, seen from the other end
        here = tuple(slice(max(0, -d), n - max(0, d)) for d, n in zip(step, cost.shape, strict=True))
        there = tuple(slice(max(0, d), n - max(0, -d)) for d, n in zip(step, cost.shape, strict=True))
        length = np.linalg.norm(np.array(step) * spacing) * 0.5 * (cost[here] + cost[there])
        passable = np.isfinite(length)
        origins.append(numbers[here][passable])
        targets.append(numbers[there][passable])
        lengths.append(length[passable])
    entries = np.concatenate(lengths), (np.concatenate(origins), np.concatenate(targets))
    return scipy.sparse.coo_array(entries, shape=(cost.size, cost.size)).tocsr()


# ------------------------------------------------------------------------------------------------------------ rerouting


logger = logging.getLogger(__name__)

MOST_CELLS = 100_000
# What a cell costs where the body fits only if it is turned the right way; 1 where it fits in any way.
NARROW = 3.0
BLOCKED = 1e4
# Share of a path over which its corners are rounded.
ROUNDED = 0.1
# Of the smallest body: an overlap that is more than a little.
DEEP = 0.1


def reroute(block: Any) -> list[str]:
    """Reroute bodies from where they start to where they end, clear of all static obstacles.

    Only bodies whose position consists of variables are rerouted: pose rules such as
    ``planar_pose(b.x[t], b.y[t], b.theta[t])``. Fixed variables and the rotation stay as they are.

    Parameters
    ----------
    block : ObstacleAvoidanceBlockData
        Its variables hold an initial guess of the motion.

    Returns
    -------
    list of str
        Names of the bodies that were rerouted.
    """
    motion, scene = block.motion, block.record.scene
    nodes = motion.nodes
    if len(nodes) < 3:
        return []
    rerouted = []
    for name, body in scene.bodies.items():
        if name in scene.obstacles or not body.moves:
            continue
        poses = [motion.pose_at_node(body.pose, node, name=name) for node in nodes]
        entries = [pose.translation for pose in poses]
        if are_computed(entries) or not any(
            _is_variable(entry) and not entry.fixed for place in entries for entry in place
        ):
            continue
        numbers = [pose.numbers() for pose in poses]
        places = _places(block, scene, name, body, numbers, entries)
        if places is None:
            logger.info("'%s': no path around the obstacles was found for '%s'.", block.name, name)
            continue
        for place, target in zip(entries, places, strict=True):
            for entry, number in zip(place, target.tolist(), strict=True):
                if _is_variable(entry) and not entry.fixed:
                    entry.set_value(within_bounds(number, entry), skip_validation=True)
        rerouted.append(name)
    return rerouted


def runs_into_several(block: Any) -> bool:
    """Whether start values were set for a motion that runs into two or more static obstacles.

    Each has its own cheapest way out, and they may contradict each other. Where the user has said where to pass, it is
    not asked.
    """
    record = block.record
    if record.directions:
        return False
    bodies = {record.scene.parts[second].body for _, second in record.overlapping}
    return sum(record.scene.is_static(body) for body in bodies) >= 2


def overlaps_deeply(block: Any) -> bool:
    """Whether shapes overlap, where the separations of a block start now, by more than a tenth of the smallest body."""
    reach = min(part.shape.reach for part in block.record.scene.parts.values() if part.shape.is_bounded)
    return min(block.separation_gaps().values(), default=0.0) < -DEEP * reach


@dataclass(frozen=True)
class InnerAndOuterBall:
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
    def of(cls, shape: Polytope) -> InnerAndOuterBall:
        """About the mean of the corners."""
        middle, inner = shape.center, 0.0
        if not shape.is_flat:
            normals, offsets = shape.halfspaces
            inner = float((offsets - normals @ middle).min())
        elif shape.ellipsoids is not None:
            inner = float(np.linalg.norm(shape.ellipsoids, -2, axis=(1, 2)).min())
        outer = float(np.linalg.norm(shape.covering - middle, axis=1).max())
        return cls(middle, max(inner, 0.0) + shape.radius, outer + shape.radius)


def path_among_obstacles(
    start: Array,
    goal: Array,
    balls: InnerAndOuterBall,
    obstacles: Sequence[Polytope],
    clearance: float,
    low: Array,
    high: Array,
) -> Array | None:
    """Shortest path on a grid for the inner ball of a body, with a preference for cells where the outer ball fits.

    Parameters
    ----------
    start, goal : (d,) array
        Of the body's middle.
    balls : InnerAndOuterBall
        Of the body.
    obstacles : sequence of Polytope
        Placed in the world.
    clearance : float
        To be kept by the inner ball, so that a body that fits finds its path.
    low, high : (d,) array
        Corners of the region that is searched; start and goal are inside.

    Returns
    -------
    (k, d) array, or None
        Points from start to goal; None where there is no path on this grid.

    Notes
    -----
    Distances are those to the facets' planes and to the box around each obstacle, whichever is larger: never more than
    the true ones. Cells are taken to be blocked within half of their diagonal, so that no wall is stepped through.
    """
    size = np.maximum(high - low, 1e-9)
    finest = max(balls.inner + clearance, 1e-3 * float(size.max()))
    cell = max(finest / np.sqrt(len(size)), float((size.prod() / MOST_CELLS) ** (1 / len(size))))
    counts = np.maximum(np.ceil(size / cell).astype(int), 1) + 1
    axes = [np.linspace(a, b, n) for a, b, n in zip(low, high, counts, strict=True)]
    needed = max(balls.inner + clearance, 0.5 * cell * np.sqrt(len(size)))
    comfort = max(balls.outer + clearance, needed + cell)
    distance = grid_lower_bounds(axes, obstacles, comfort)
    cost = 1.0 + NARROW * np.clip((comfort - distance) / (comfort - needed), 0.0, 1.0)
    cost[distance < needed] = BLOCKED
    spacing = size / (counts - 1)
    first, last = (tuple(np.rint((end - low) / spacing).astype(int).tolist()) for end in (start, goal))
    cells = grid_path(cost, spacing, first, last)
    assert cells is not None  # blocked cells are expensive, not impassable
    path = low + cells * spacing
    # The ends of the path may be in places too tight for the grid. Elsewhere it must not pass through a wall.
    far = np.minimum(*(np.linalg.norm(path - end, axis=1) for end in (start, goal))) > balls.outer + cell
    if (cost[tuple(cells.T)] >= BLOCKED)[far].any():
        return None
    return np.vstack([start, path[1:-1], goal])


def grid_lower_bounds(axes: Sequence[Array], obstacles: Sequence[Polytope], beyond: float) -> Array:
    """Lower bounds of the distances of all points of a grid to the nearest of the obstacles, at most `beyond`.

    Parameters
    ----------
    axes : sequence of (n_i,) array
        Coordinates along each axis, increasing.
    obstacles : sequence of Polytope
    beyond : float
        Each obstacle concerns the cells around it only.
    """
    distances = np.full([len(axis) for axis in axes], beyond)
    for obstacle in obstacles:
        window = tuple(slice(None) for _ in axes)
        if obstacle.is_bounded:
            below, above = obstacle.bounding_box[0] - beyond, obstacle.bounding_box[1] + beyond
            window = tuple(
                slice(int(np.searchsorted(axis, low)), int(np.searchsorted(axis, high, side="right")))
                for axis, low, high in zip(axes, below, above, strict=True)
            )
        near = np.stack(
            np.meshgrid(*(axis[part] for axis, part in zip(axes, window, strict=True)), indexing="ij"), axis=-1
        )
        if near.size:
            bounds = distance_lower_bounds(near.reshape(-1, len(axes)), [obstacle]).reshape(near.shape[:-1])
            distances[window] = np.minimum(distances[window], bounds)
    return distances


def distance_lower_bounds(points: Array, obstacles: Sequence[Polytope]) -> Array:
    """Lower bounds (k,) of the distances of points (k, d) to the nearest of the obstacles."""
    distances = np.full(len(points), np.inf)
    for obstacle in (each.covered for each in obstacles):
        bound = np.full(len(points), -np.inf)
        if not obstacle.is_flat:
            normals, offsets = obstacle.halfspaces
            bound = np.maximum(bound, (points @ normals.T - offsets).max(axis=1))
        if obstacle.is_bounded:
            below, above = obstacle.bounding_box[0] + obstacle.radius, obstacle.bounding_box[1] - obstacle.radius
            outside = np.maximum(below - points, points - above)
            bound = np.maximum(bound, np.where(outside.max(axis=1) > 0, np.linalg.norm(outside.clip(0), axis=1), bound))
        distances = np.minimum(distances, bound - obstacle.radius)
    return distances


def _places(block: Any, scene: Scene, name: str, body: Body, numbers: Any, entries: Any) -> Array | None:
    """Translations (nodes, d) along the path, each at the fraction that the guess has covered; None without a path."""
    balls = balls_of(scene, name)
    walls = [wall.shape for _, wall in scene.walls_of(name)]
    if not walls:
        return None
    arms = np.array([rotation @ balls.middle for rotation, _ in numbers])
    before = np.array([place for _, place in numbers]) + arms
    clearance = max(value for pair, value in scene.clearances.items() if name in pair)
    low, high = _region(before, balls, clearance, entries, arms)
    path = path_among_obstacles(before[0], before[-1], balls, walls, clearance, low, high)
    return None if path is None else _along(path, before) - arms


def balls_of(scene: Scene, name: str) -> InnerAndOuterBall:
    """Of the part with the largest inner ball: it stands for a union of parts."""
    return max((InnerAndOuterBall.of(part.shape) for part in scene.parts_of(name)), key=lambda balls: balls.inner)


def _region(
    before: Array, balls: InnerAndOuterBall, clearance: float, entries: Any, arms: Array
) -> tuple[Array, Array]:
    """The region to search: around the guess by its own extent and twice the body's, within the bounds of variables."""
    beyond = 0.5 * float(np.ptp(before, axis=0).max()) + 2 * (balls.outer + clearance)
    low, high = before.min(axis=0) - beyond, before.max(axis=0) + beyond
    middle = len(entries) // 2
    for axis, entry in enumerate(entries[middle]):
        if _is_variable(entry):
            reach = np.abs(arms[:, axis]).max()
            low[axis] = max(low[axis], within_bounds(-np.inf, entry) - reach)
            high[axis] = min(high[axis], within_bounds(np.inf, entry) + reach)
    return np.minimum(low, before.min(axis=0)), np.maximum(high, before.max(axis=0))


def _along(path: Array, before: Array) -> Array:
    """Points (nodes, d) of a path, rounded, at the fractions of its length that the guess has covered of its own."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(before, axis=0), axis=1))])
    shares = lengths / lengths[-1] if lengths[-1] > 0 else np.linspace(0, 1, len(before))
    passed = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    fine = np.linspace(0.0, 1.0, 20 * len(before) + 1)
    line = np.stack([np.interp(fine * passed[-1], passed, column) for column in path.T], axis=1)
    width = max(int(ROUNDED * len(fine)) // 2, 1)
    smooth = scipy.ndimage.uniform_filter1d(line, 2 * width + 1, axis=0, mode="nearest")
    return np.stack([np.interp(shares, fine, column) for column in smooth.T], axis=1)


def are_computed(places: Sequence[Any]) -> bool:
    """Whether a coordinate is neither a variable nor a number: the links of an arm cannot be led along a path."""
    return any(not (is_number(entry) or _is_variable(entry)) for place in places for entry in place)


def _is_variable(entry: Any) -> bool:
    return not is_number(entry) and entry.is_variable_type()
