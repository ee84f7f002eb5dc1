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

from pyrobocop_pyomo.motion.moving_shapes import SAMPLES, MovingShape, moving_shapes
from pyrobocop_pyomo.motion.required_clearance import RequiredClearance, required_clearance
from pyrobocop_pyomo.motion.safety_report import SafetyReport
from pyrobocop_pyomo.numerics import Array

from .avoidance_record import MotionSegment
from .broad_phase import places_of
from .clearances import ClearanceRule
from .containment import ContainmentData
from .scene import SeparationIndex
from .separation_rows import unit_normal_of

logger = logging.getLogger(__name__)


# The next motion will differ from the last: a margin is this many times the chord deviation.
DEVIATION_FACTOR = 1.25
# Separations whose segment is at most this part of its interval are not split.
SMALLEST_PART = 1.0 / 32.0


def tighten(block: Any, report: SafetyReport, *, split: bool) -> list[str]:
    """Tighten an avoidance block, or a containment, where a motion is not proven to keep its clearances.

    Parameters
    ----------
    block : ObstacleAvoidanceBlockData or ContainmentData
        Its variables hold the motion.
    report : SafetyReport
        Of that motion, by this block.
    split : bool
        Whether the least margins have not been enough: then whole chord deviations are required, and separations split.

    Returns
    -------
    list of str
        What was done; empty where nothing could be done.
    """
    if isinstance(block, ContainmentData):
        return _tighten_region(block, report)
    record = block.record
    if not record.per_interval:
        return _restore_at_points(block, report)
    done: dict[str, int] = {}
    present = places_of(record.segments.values())
    of_equations = _equations_deviations(record, report)
    wanted: dict[SeparationIndex, float] = {}
    beside: dict[SeparationIndex, float] = {}
    to_split: list[SeparationIndex] = []
    missed = []
    for pair in report.body_pairs:
        for interval in pair.unproven:
            # Where no instant is too close, only the proof is missing, by at most the tolerance.
            missing = float(np.fmax(pair.missing[interval], pair.tolerance))
            place = (pair.first, pair.second, interval)
            segments = present.get(place, ())
            here = {segment.index: value(block.margin[segment.index]) + missing for segment in segments}
            wanted |= here
            if interval not in pair.plan_only:  # planes of shorter segments bring the equations no nearer
                to_split += here
            missed += [] if place in present else [place]
            # Where the motion gives way here, it comes closer before or after.
            near = [of for step in (-1, 1) for of in present.get((pair.first, pair.second, interval + step), ())]
            most = max(here.values(), default=0.0)
            beside |= {segment.index: max(most, beside.get(segment.index, 0.0)) for segment in near}
    restored = block.restore_near(missed)
    if restored:
        done["separations restored"] = len(restored)
    paths = _Paths(block)
    for index in {**wanted, **beside}:
        before = value(block.margin[index])
        enough = DEVIATION_FACTOR * paths.deviation(record.segments[index]) + of_equations.get(index, 0.0)
        # First the least: what is missing here, and beside it no more than that. Later whole deviations.
        asked = wanted.get(index, min(enough, beside.get(index, 0.0)))
        asked = max(asked, enough) if split else asked
        if asked > before:
            block.set_margin(*index, asked)
            done["margins raised"] = done.get("margins raised", 0) + 1
    if split:
        count = sum(_split(block, index, paths) for index in dict.fromkeys(to_split))
        if count:
            done["separations split"] = count
    return _logged(block, [f"{count} {what}" for what, count in done.items()])


def _tighten_region(region: ContainmentData, report: SafetyReport) -> list[str]:
    """Raise margins where a motion leaves a region between the times at which corners have rows."""
    intervals = region.motion.intervals
    missing = np.zeros(len(intervals))
    for pair in report.body_pairs if intervals else ():
        # Where no instant is too close, only the proof is missing, by at most the tolerance.
        unproven = list(pair.unproven)
        missing[unproven] = np.fmax(missing[unproven], np.fmax(pair.missing[unproven], pair.tolerance))
    for interval in np.flatnonzero(missing).tolist():
        before = max(value(region.margin[time]) for time in intervals[interval])
        region.set_margin(interval, before + DEVIATION_FACTOR * float(missing[interval]))
    count = int(np.count_nonzero(missing))
    return _logged(region, [f"{count} margins to a region raised"] if count else [])


def _restore_at_points(block: Any, report: SafetyReport) -> list[str]:
    """Restore separations that were left out: those of single times cannot be tightened for the motion in between."""
    motion = block.motion
    missed = []
    for pair in report.body_pairs:
        for place in pair.unproven:
            times = motion.intervals[place] if motion.intervals else (motion.points[place],)
            missed += [(pair.first, pair.second, time) for time in times]
    count = len(block.restore_near(missed))
    return _logged(block, [f"{count} separations restored"] if count else [])


def _logged(block: Any, done: list[str]) -> list[str]:
    logger.info("'%s': %s", block.name, ", ".join(done) or "nothing left to tighten")
    return done


class _Paths:
    """Paths of the corners of all parts."""

    def __init__(self, block: Any) -> None:
        record, motion = block.record, block.motion
        shapes = moving_shapes(motion, record.scene.watched_bodies)
        self._block = block
        self._shapes = {shape.name: shape for parts in shapes.values() for shape in parts}
        self._bodies = {name: part.body for name, part in record.scene.parts.items()}
        # What a clearance asks for counts like the reach of a shape: along its chord it is covered, above it is not.
        self._rising = {
            pair: required_clearance(motion, asked, pair)
            for pair, asked in record.asked.items()
            if isinstance(asked, ClearanceRule)
        }

    def deviation(self, segment: MotionSegment) -> float:
        """How much farther the shapes reach across their plane during a segment than at its poses."""
        normal = unit_normal_of(self._block, segment.index)
        if normal is None:
            return 0.0
        rising = self._rising.get((self._bodies[segment.first], self._bodies[segment.second]))
        found = 0.0
        for name, direction in ((segment.first, -normal), (segment.second, normal)):
            shape = self._shapes[name]
            if shape.template is not None:
                # A changing clearance grows one of the two shapes: the first, unless that one rests.
                found += _reach_beyond(shape, segment, direction, rising)
                rising = None
        return found


def _equations_deviations(record: Any, report: SafetyReport) -> dict[SeparationIndex, float]:
    """How far the equations lead the shapes of each separation away from the plan; left out where nobody knows."""
    pairs = {(pair.first, pair.second): pair for pair in report.body_pairs}
    found: dict[SeparationIndex, float] = {}
    for segment in record.segments.values():
        pair = pairs.get((segment.first, segment.second))
        if pair is not None and segment.interval is not None:
            deviation = float(pair.interval_deviation[segment.interval])
            if 0.0 < deviation < np.inf:
                found[segment.index] = deviation
    return found


def _reach_beyond(
    shape: MovingShape, segment: MotionSegment, direction: Array, rising: RequiredClearance | None
) -> float:
    """How much farther one shape, grown by what is required, reaches along a direction than at the poses."""
    posed = np.array(segment.fractions)
    fractions = np.concatenate([posed, np.linspace(posed[0], posed[-1], SAMPLES)])
    interval = np.full(len(fractions), segment.interval)
    corners, _ = shape.corners(interval, fractions)
    reach = (corners @ direction).max(axis=1)
    if rising is not None:
        reach = reach + rising.values(interval, fractions)
    return float(reach.max() - reach[: len(posed)].max())


def _split(block: Any, index: SeparationIndex, paths: _Paths) -> bool:
    segment = block.record.segments[index]
    if segment.fractions[-1] - segment.fractions[0] <= SMALLEST_PART:
        return False
    # What was asked beyond the chord deviation: the motion of the equations may need it in both halves.
    beyond = max(value(block.margin[index]) - DEVIATION_FACTOR * paths.deviation(segment), 0.0)
    for half in block.split(*index):
        # The chord deviation of a half is smaller than that of the whole segment.
        block.set_margin(*half, DEVIATION_FACTOR * paths.deviation(block.record.segments[half]) + beyond)
    return True
