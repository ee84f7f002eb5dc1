"""The broad phase: which separations a solve needs, by how near the shapes come to each other.

Distances are distances of the convex hulls of all that two shapes sweep in a segment of motion, as in the start values.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterable, Sequence
from typing import Any

import numpy as np

from pyrobocop_pyomo.geometry import distances_of_shapes
from pyrobocop_pyomo.motion.safety_report import SafetyReport
from pyrobocop_pyomo.numerics import Array, BoolArray
from pyrobocop_pyomo.optional_imports import scipy

from .avoidance_record import AvoidanceRecord, MotionSegment, Snapshot
from .separation_rows import add_separation, remove_separations

# With so few separations the broad phase that is on by itself leaves none out.
KEPT_ANYWAY = 200
# A model with more separations than this is not built before its motion has an initial guess.
BUILT_WITHOUT_GUESS = 2000
# Share of all intervals by which a plan may be earlier or later at a place than the initial guess.
EARLIER_OR_LATER = 0.04


def swept_distances(snapshot: Snapshot, segments: Sequence[MotionSegment]) -> tuple[Array, Array]:
    """Signed distances (k,) and normals (k, d) of what two shapes sweep on each segment, as `distances_of_shapes`."""
    return distances_of_shapes([snapshot.placed_pair(segment) for segment in segments])


# ------------------------------------------------------------------------------------------------- what is left out


def has_broad_phase(record: AvoidanceRecord) -> bool:
    """Whether separations may be left out at all."""
    if record.broad_phase == "auto":
        return not record.depends_on_what_is_far and len(record.segments) + len(record.pruned) > KEPT_ANYWAY
    return record.broad_phase is not None


def near_segments(snapshot: Snapshot, segments: Sequence[MotionSegment]) -> BoolArray:
    """Which segments the broad phase keeps at the current poses, shape (k,)."""
    record = snapshot.record
    if not has_broad_phase(record):
        return np.ones(len(segments), dtype=bool)
    distances, _ = swept_distances(snapshot, segments)
    if not isinstance(record.broad_phase, str):
        return ~(distances > float(record.broad_phase or 0.0))
    deepest = float(np.maximum(-distances[np.isfinite(distances)], 0.0).max(initial=0.0))
    # Whoever leaves an overlap on its other side goes farther than its depth, and by its own size past the neighbours.
    return _earlier_or_later(record, segments, distances, least_reach(record) + deepest)


def least_reach(record: AvoidanceRecord) -> float:
    """What a broad phase that is on by itself looks at in any scene: twice the clearance and the largest mover."""
    scene = record.scene
    movers = {part.name: part.shape for part in scene.parts.values() if not scene.is_static(part.body)}
    sizes = [float(np.linalg.norm(np.ptp(shape.bounding_box, axis=0))) for shape in movers.values()]
    return 2.0 * max(scene.clearances.values()) + max(sizes, default=0.0)


def _earlier_or_later(
    record: AvoidanceRecord, segments: Sequence[MotionSegment], distances: Array, reach: float
) -> BoolArray:
    """Segments within reach, and intervals shortly before and after: plans change the speed of a guess first."""
    near: BoolArray = ~(distances > reach)
    if not record.per_interval:
        return near
    pairs = {pair: k for k, pair in enumerate(dict.fromkeys((of.first, of.second) for of in segments))}
    row = np.array([pairs[of.first, of.second] for of in segments], dtype=int)
    interval = np.array([of.interval for of in segments], dtype=int)
    reached = np.zeros((len(pairs), 1 + interval.max(initial=0)), dtype=bool)
    reached[row[near], interval[near]] = True
    width = 2 * int(np.ceil(EARLIER_OR_LATER * reached.shape[1])) + 1
    widened = scipy.ndimage.maximum_filter1d(reached, width, axis=1, mode="constant", cval=False)
    return np.asarray(widened[row, interval])


def apply_broad_phase(block: Any, snapshot: Snapshot) -> None:
    """Remove separations of shapes that are far apart at the current poses, and add those that are not any more."""
    record = snapshot.record
    if not (has_broad_phase(record) or record.pruned):
        return
    everywhere = [*record.segments.values(), *record.pruned.values()]
    kept = near_segments(snapshot, everywhere)
    near, far = ([everywhere[k] for k in np.flatnonzero(of).tolist()] for of in (kept, ~kept))
    removed = [of for of in far if of.index in record.segments and of.index not in record.pinned]
    added = [of for of in near if of.index in record.pruned]
    remove_separations(block, record, removed)
    record.pruned.update({segment.index: segment for segment in removed})
    restore_separations(block, record, added)


def restore_separations(block: Any, record: AvoidanceRecord, segments: Sequence[MotionSegment]) -> None:
    """Add separations that were left out; they have no start values yet."""
    for segment in segments:
        del record.pruned[segment.index]
        add_separation(block, record, segment)


def ran_through_what_was_left_out(block: Any, report: SafetyReport) -> bool:
    """Whether a motion overlaps with something from which no separation kept it away."""
    present = segments_by_place(block.record.segments.values())
    return block.record.per_interval and any(
        (pair.first, pair.second, interval) not in present
        for pair in report.body_pairs
        for interval in np.flatnonzero(pair.interval_distance < 0.0).tolist()
    )


def segments_by_place(segments: Iterable[MotionSegment]) -> dict[tuple[str, str, Hashable], list[MotionSegment]]:
    """Segments by their two parts and their interval, or their time where they are for a single one."""
    places: dict[tuple[str, str, Hashable], list[MotionSegment]] = defaultdict(list)
    for segment in segments:
        place = segment.times[0] if segment.interval is None else segment.interval
        places[segment.first, segment.second, place].append(segment)
    return places
