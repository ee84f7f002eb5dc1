"""Margins, splits and restored separations for the next solve, where a motion is not proven to keep its clearances.

Rows hold at poses, and between them a motion may come closer. By how much, the proof of the last motion has found, and
a margin of that size is required in the next solve. `verify` proves the result.
"""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.motion.safety_report import BodyPairSafety, SafetyReport

from .broad_phase import segments_by_place
from .containment import ContainmentData

logger = logging.getLogger(__name__)

# The next motion will differ from the last: where the missing distance alone was not enough, this many times it is.
MISSING_FACTOR = 1.25
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
        Whether margins have not been enough: then separations are split.

    Returns
    -------
    list of str
        What was done; empty where nothing could be done.
    """
    if isinstance(block, ContainmentData):
        done = _raise_margins_to_region(block, report)
    else:
        done = _tighten_separations(block, report, split=split)
    words = [f"{count} {what}" for what, count in done.items() if count]
    logger.info("'%s': %s", block.name, ", ".join(words) or "nothing left to tighten")
    return words


def _tighten_separations(block: Any, report: SafetyReport, *, split: bool) -> dict[str, int]:
    motion, per_interval = block.motion, block.record.per_interval
    present = segments_by_place(block.record.segments.values()) if per_interval else {}
    places = [(pair, interval) for pair in report.body_pairs for interval in pair.unproven]
    missed = []
    for pair, k in places:
        # Separations of single times cannot be tightened for the motion in between: those left out are restored.
        missed += [(pair.first, pair.second, place) for place in ((k,) if per_interval else motion.intervals[k])]
    done = {"separations restored": len(block.restore(missed)), "margins raised": 0, "separations split": 0}
    for pair, interval in places:
        for segment in present.get((pair.first, pair.second, interval), ()):
            more = MISSING_FACTOR if split else 1.0  # margins make paths longer: the least is tried first
            margin = value(block.margin[segment.index]) + more * _missing(pair)[interval]
            # Planes of shorter segments bring the motion of the equations no nearer.
            is_long = segment.fractions[-1] - segment.fractions[0] > SMALLEST_PART
            if split and interval not in pair.plan_only and is_long:
                done["separations split"] += 1
                for half in block.split(*segment.index):
                    block.set_margin(*half, margin / 4.0)  # so much less does it deviate from its chord
            else:
                done["margins raised"] += 1
                block.set_margin(*segment.index, margin)
    return done


def _raise_margins_to_region(region: ContainmentData, report: SafetyReport) -> dict[str, int]:
    """Raise margins where a motion leaves a region between the times at which corners have rows."""
    intervals = region.motion.intervals
    more = np.zeros(len(intervals))
    for pair in report.body_pairs:
        unproven = list(pair.unproven)
        more[unproven] = np.fmax(more[unproven], MISSING_FACTOR * _missing(pair)[unproven])
    for interval in np.flatnonzero(more).tolist():
        region.set_margin(interval, max(value(region.margin[time]) for time in intervals[interval]) + more[interval])
    return {"margins to a region raised": int(np.count_nonzero(more))}


def _missing(pair: BodyPairSafety) -> Any:
    """By how much the distance misses the required one, in each interval; for intervals that are not proven."""
    # Where no instant is too close, only the proof is missing, by at most the tolerance.
    return np.fmax(pair.missing, pair.tolerance)
