"""Start values of separations from exact distances at the current poses, and the broad phase.

Where shapes overlap, a normal of the deepest overlap may flip from one segment to the next. There, dynamic programming
chooses normals that are cheap and consistent along time.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import distance_of_points, separating_directions
from pyrobocop_pyomo.numerics import Array, BoolArray

from .avoidance_record import AvoidanceRecord, MotionSegment
from .formulations import PlacedShape
from .scene import BodyPair
from .separation_rows import add_separation, remove_separation
from .snapshot import Snapshot, gap_along

LOGGER = logging.getLogger(__name__)

PlacedPair = tuple[PlacedShape, PlacedShape]

# Relative to the size of the shapes: weight of a random preference for a direction, and tilt of the normals.
PREFERENCE = 1e-3


def start_all(block: Any, snapshot: Snapshot, directions: Mapping[BodyPair, Array], seed: int) -> dict[BodyPair, int]:
    """Set start values of every separation.

    Returns
    -------
    dict of pair of parts to int
        Number of segments on which they overlap at the initial guess; pairs without overlap are left out.
    """
    record = snapshot.record
    generator = np.random.default_rng(seed)
    overlapping = {}
    for first, second in record.scene.part_pairs():
        segments = record.segments_of(first.name, second.name)
        if not segments:
            continue
        placed = [snapshot.placed_pair(segment) for segment in segments]
        wanted = directions.get((first.body, second.body))
        normals, gaps = choose_normals(placed, generator, wanted)
        for segment, pair, normal in zip(segments, placed, normals, strict=True):
            _start(block, record, segment, pair, normal)
        if (gaps <= 0).any():
            overlapping[first.name, second.name] = int((gaps <= 0).sum())
    if overlapping:
        LOGGER.info(
            "%s: the initial guess overlaps for %s; normals are chosen along time, ties broken with seed %d.",
            snapshot.what,
            ", ".join(f"'{a}' and '{b}' ({count} separations)" for (a, b), count in overlapping.items()),
            seed,
        )
    return overlapping


def start_one(block: Any, snapshot: Snapshot, segment: MotionSegment, normal: Array | None = None) -> None:
    """Set start values of one separation; where shapes overlap, with the given normal."""
    pair = snapshot.placed_pair(segment)
    usable = normal is not None and np.isfinite(normal).all() and np.linalg.norm(normal) > 0
    direction = normal / np.linalg.norm(normal) if usable and normal is not None else None
    normals, _ = choose_normals([pair], np.random.default_rng(0), direction)
    _start(block, snapshot.record, segment, pair, normals[0])


def _start(block: Any, record: AvoidanceRecord, segment: MotionSegment, pair: PlacedPair, normal: Array) -> None:
    index = segment.index
    if record.soft:
        block.slack[index].set_value(0.0)
        proven = float(gap_along(normal[None, :], *pair)[0]) + pair[0].shape.radius + pair[1].shape.radius
        block.slack[index].set_value(max(0.0, value(block.required[index]) - proven))
    record.formulation.start(block, index, *pair, normal)


# ---------------------------------------------------------------------------------------------------------- broad phase


def apply_broad_phase(block: Any, snapshot: Snapshot) -> None:
    """Remove separations of shapes that are far apart at the current poses, and add those that are not any more."""
    record = snapshot.record
    for segment in list(record.segments.values()):
        if segment.index not in record.pinned and is_far(snapshot, segment):
            remove_separation(block, record, segment)
            record.pruned[segment.index] = segment
    for segment in list(record.pruned.values()):
        if not is_far(snapshot, segment):
            del record.pruned[segment.index]
            add_separation(block, record, segment)


def is_far(snapshot: Snapshot, segment: MotionSegment) -> bool:
    """True when the broad phase may leave a segment out at the current poses."""
    length = snapshot.record.broad_phase
    return length is not None and _farther_apart(*snapshot.placed_pair(segment), length)


def _farther_apart(first: PlacedShape, second: PlacedShape, length: float) -> bool:
    """True when the convex hulls of all that two shapes sweep are farther apart than a length."""
    radii = first.shape.radius + second.shape.radius
    unbounded = len(first.rays) or len(second.rays)
    # Boxes decide most cases, and the exact distance decides the others.
    if not unbounded and _box_distance(first.vertices, second.vertices) - radii > length:
        return True
    near = distance_of_points(first.vertices, second.vertices, q_rays=second.rays, p_rays=first.rays)
    return bool(near.distance - radii > length)


def _box_distance(first: Array, second: Array) -> float:
    """Distance between the axis-aligned boxes around two sets of points (k, d)."""
    between = np.maximum(first.min(axis=0) - second.max(axis=0), second.min(axis=0) - first.max(axis=0))
    return float(np.linalg.norm(np.maximum(between, 0.0)))


# --------------------------------------------------------------------------------------------------- choice of normals


def choose_normals(
    pairs: Sequence[PlacedPair], generator: np.random.Generator, direction: Array | None = None
) -> tuple[Array, Array]:
    """Unit normals for the segments of one pair of parts, along time.

    Where the swept shapes are apart, the normal of their distance. Where they overlap, normals with the least sum of
    overlap depths and turns, between the normals of the segments before and after.

    Parameters
    ----------
    pairs : sequence of (first, second)
        One per segment.
    generator : numpy.random.Generator
        Breaks ties where opposite directions are equally good.
    direction : (d,), optional
        Unit vector to be used wherever shapes overlap.

    Returns
    -------
    normals : (k, d)
    gaps : (k,)
        Signed distances of the swept shapes, negative where they overlap.

    Raises
    ------
    ObstacleError
        When both are unbounded, and no direction separates them.
    """
    nearest = [distance_of_points(p.vertices, q.vertices, q_rays=q.rays, p_rays=p.rays) for p, q in pairs]
    gaps = np.array(
        [near.distance - p.shape.radius - q.shape.radius for near, (p, q) in zip(nearest, pairs, strict=True)]
    )
    normals = np.array([near.normal for near in nearest])
    if np.isneginf(gaps).any():
        names = [placed.shape.name for placed in pairs[int(gaps.argmin())]]
        raise ObstacleError(
            f"'{names[0]}' and '{names[1]}' overlap without end: no plane separates them anywhere. Bound one of them."
        )
    for run in _runs(gaps <= 0):
        if direction is not None:
            normals[run] = direction
            continue
        before = normals[run.start - 1] if run.start > 0 else None
        after = normals[run.stop] if run.stop < len(pairs) else None
        extra = [normal for normal in (before, after) if normal is not None]
        candidates = [_candidates(*pairs[k], [normals[k], *extra]) for k in range(run.start, run.stop)]
        preferred = np.array(generator.standard_normal(normals.shape[1]))
        preferred = preferred / np.linalg.norm(preferred)
        chosen = _cheapest_path(candidates, pairs[run], before, after, preferred)
        tilted = chosen + PREFERENCE * generator.standard_normal(chosen.shape)
        normals[run] = tilted / np.linalg.norm(tilted, axis=1, keepdims=True)
    return normals, gaps


def _runs(overlapping: BoolArray) -> list[slice]:
    """Runs of consecutive segments that overlap."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], overlapping.astype(int), [0]])))
    return [slice(int(start), int(stop)) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def _candidates(first: PlacedShape, second: PlacedShape, extra: list[Array]) -> Array:
    """Directions (k, d) in which to leave an overlap: facets of the Minkowski difference, axes, and given ones.

    The axes are included because shapes without an interior, such as points, have no facets.
    """
    dimension = first.vertices.shape[1]
    axes = np.vstack([np.eye(dimension), -np.eye(dimension)])
    facets = separating_directions(first.vertices, second.vertices, first.rays, second.rays)
    directions = np.vstack([facets, axes, *extra])
    blocked = ((second.rays @ directions.T) > 1e-9).any(axis=0) | ((first.rays @ directions.T) < -1e-9).any(axis=0)
    return directions[~blocked] if not blocked.all() else directions[-1:]


def _cheapest_path(
    candidates: list[Array], pairs: Sequence[PlacedPair], before: Array | None, after: Array | None, preferred: Array
) -> Array:
    """Normals (k, d) of least cost: mean depth over size, plus the squared angles between consecutive normals."""
    depths = []
    for directions, (first, second) in zip(candidates, pairs, strict=True):
        depth = -gap_along(directions, first, second)
        size = max(float(np.ptp(second.vertices, axis=0).max() + np.ptp(first.vertices, axis=0).max()), 1e-12)
        depths.append((depth / size - PREFERENCE * directions @ preferred) / len(pairs))
    cost = depths[0] if before is None else depths[0] + _turning(before[None, :], candidates[0])[0]
    origins = []
    for k in range(1, len(pairs)):
        total = cost[:, None] + _turning(candidates[k - 1], candidates[k])
        origins.append(total.argmin(axis=0))
        cost = total.min(axis=0) + depths[k]
    if after is not None:
        cost = cost + _turning(candidates[-1], after[None, :])[:, 0]
    choice = [int(cost.argmin())]
    for origin in reversed(origins):
        choice.append(int(origin[choice[-1]]))
    return np.array([directions[k] for directions, k in zip(candidates, reversed(choice), strict=True)])


def _turning(before: Array, after: Array) -> Array:
    """Squared angles (k, l) between unit vectors (k, d) and (l, d); squares favour two small turns over a flip."""
    return np.arccos(np.clip(before @ after.T, -1.0, 1.0)) ** 2
