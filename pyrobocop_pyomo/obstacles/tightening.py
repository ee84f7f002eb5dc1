"""Margins, splits and restored separations for the next solve, where a motion is not proven to keep its clearances.

A plane that separates the poses of its segment may be crossed between them, because the paths of the vertices deviate
from their chords. This *chord deviation* is measured on the last motion and becomes the margin of the next solve.
Samples are enough for it, since `verify` proves the result.
"""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.motion.motion import Motion
from pyrobocop_pyomo.motion.moving_shapes import MovingShape, moving_shapes
from pyrobocop_pyomo.motion.safety_report import BodyPairSafety, SafetyReport
from pyrobocop_pyomo.numerics import Array

from .avoidance_record import MotionSegment
from .formulations import SeparationIndex

logger = logging.getLogger(__name__)


# The next motion will differ from the last: a margin is this many times the chord deviation.
DEVIATION_FACTOR = 1.25
SAMPLES_PER_SEGMENT = 33
# Separations whose segment is at most this part of its interval are not split.
SMALLEST_PART = 1.0 / 32.0


def tighten(block: Any, report: SafetyReport, *, split: bool) -> list[str]:
    """Tighten an avoidance block where a motion is not proven to be clear.

    Parameters
    ----------
    block : ObstacleAvoidanceBlockData
        Its variables hold the motion.
    report : SafetyReport
        Of that motion, by this block.
    split : bool
        Whether separations are split where margins alone have not been enough.

    Returns
    -------
    list of str
        What was done; empty where nothing could be done.
    """
    record = block.record
    if not record.per_interval:
        return _restore_at_points(block, report)
    done: dict[str, int] = {}
    paths = _Paths(record, block.motion)
    deviations = {index: paths.deviation(segment, _normal(block, index)) for index, segment in record.segments.items()}
    unsafe: dict[SeparationIndex, float] = {}
    for pair in report.body_pairs:
        for interval in pair.unproven:
            bodies = (record.scene.parts[name].body for name in (pair.first, pair.second))
            restored = block.restore(*bodies, interval)
            if restored:
                done["separations restored"] = done.get("separations restored", 0) + len(restored)
                continue
            missing = pair.clearance - float(np.nan_to_num(pair.interval_distance[interval], nan=pair.clearance))
            unsafe |= {segment.index: missing for segment in _segments(record, pair, interval)}
    for index, deviation in deviations.items():
        before = value(block.margin[index])
        wanted = DEVIATION_FACTOR * deviation
        if index in unsafe:
            # The deviation alone was not enough last time, or the closest instant has another normal.
            wanted = max(wanted, before + unsafe[index])
        if wanted > before:
            block.set_margin(*index, wanted)
            done["margins raised"] = done.get("margins raised", 0) + 1
    if split:
        count = sum(_split(block, index, paths) for index in unsafe)
        if count:
            done["separations split"] = count
    return _logged(block, [f"{count} {what}" for what, count in done.items()])


def tighten_containment(region: Any, report: SafetyReport) -> list[str]:
    """Raise margins where a motion leaves a region between the times at which corners have rows.

    Parameters
    ----------
    region : ContainmentData
    report : SafetyReport
        Of the motion that its variables hold.

    Returns
    -------
    list of str
        What was done; empty where nothing could be done.
    """
    intervals = region.motion.intervals
    missing = np.zeros(len(intervals))
    for pair in report.body_pairs if intervals else ():
        # Where no instant is too close, only the proof is missing, by at most the tolerance.
        distance = np.fmin(np.nan_to_num(pair.interval_distance, nan=np.inf), pair.clearance - pair.tolerance)
        unproven = pair.interval_proven < pair.clearance - pair.tolerance
        missing = np.maximum(missing, np.where(unproven, pair.clearance - distance, 0.0))
    for interval in np.flatnonzero(missing).tolist():
        before = max(value(region.margin[time]) for time in intervals[interval])
        region.set_margin(interval, before + DEVIATION_FACTOR * float(missing[interval]))
    count = int(np.count_nonzero(missing))
    return _logged(region, [f"{count} margins to a region raised"] if count else [])


def split_violated(block: Any, tolerance: float = 1e-6) -> int:
    """Split the separations that are violated at the current values: their segments may be too long for one plane.

    Returns
    -------
    int
        How many were split.
    """
    if not block.record.per_interval:
        return 0
    gaps = block.separation_gaps()
    violated = [index for index, gap in gaps.items() if gap < value(block.required[index]) - tolerance]
    paths = _Paths(block.record, block.motion)
    return sum(_split(block, index, paths) for index in violated)


def _restore_at_points(block: Any, report: SafetyReport) -> list[str]:
    """Restore separations that were left out: those of single times cannot be tightened for the motion in between."""
    record, motion = block.record, block.motion
    parts, count = record.scene.parts, 0
    for pair in report.body_pairs:
        bodies = (parts[pair.first].body, parts[pair.second].body)
        for place in pair.unproven:
            times = motion.intervals[place] if motion.intervals else (motion.points[place],)
            count += sum(len(block.restore(*bodies, time)) for time in times)
    return _logged(block, [f"{count} separations restored"] if count else [])


def _logged(block: Any, done: list[str]) -> list[str]:
    logger.info("'%s': %s", block.name, ", ".join(done) or "nothing left to tighten")
    return done


class _Paths:
    """Paths of the corners of all parts."""

    def __init__(self, record: Any, motion: Motion) -> None:
        bodies = {name: record.scene.bodies[name] for pair in record.scene.body_pairs for name in pair}
        shapes = moving_shapes(motion, bodies)
        self._shapes = {shape.name: shape for parts in shapes.values() for shape in parts}

    def deviation(self, segment: MotionSegment, normal: Array) -> float:
        """How much farther the shapes reach along a normal during a segment than at its poses."""
        length = np.linalg.norm(normal)
        if not 0.0 < length < np.inf:
            return 0.0
        direction = normal / length
        first, second = (self._shapes[name] for name in (segment.first, segment.second))
        return self._reach_beyond(first, segment, -direction) + self._reach_beyond(second, segment, direction)

    def _reach_beyond(self, shape: MovingShape, segment: MotionSegment, direction: Array) -> float:
        """How much farther one shape reaches along a direction than at the poses of the segment."""
        if shape.template is None:
            return 0.0
        dense = np.linspace(segment.fractions[0], segment.fractions[-1], SAMPLES_PER_SEGMENT)
        farthest = []
        for fractions in (dense, np.array(segment.fractions)):
            corners, _ = shape.corners(np.full(len(fractions), segment.interval), fractions)
            farthest.append(float((corners @ direction).max()))
        return max(farthest[0] - farthest[1], 0.0)


def _segments(record: Any, pair: BodyPairSafety, interval: int) -> list[MotionSegment]:
    segments: list[MotionSegment] = record.segments_of(pair.first, pair.second)
    return [segment for segment in segments if segment.interval == interval]


def _split(block: Any, index: SeparationIndex, paths: _Paths) -> bool:
    segment = block.record.segments[index]
    if segment.fractions[-1] - segment.fractions[0] <= SMALLEST_PART:
        return False
    for half in block.split(*index):
        # The chord deviation of a half is smaller than that of the whole segment.
        deviation = paths.deviation(block.record.segments[half], _normal(block, half))
        block.set_margin(*half, DEVIATION_FACTOR * deviation)
    return True


def _normal(block: Any, index: SeparationIndex) -> Array:
    return np.array([value(block.normal[(*index, axis)]) for axis in block.axes], dtype=float)
