"""What an avoidance block asks for next, after a motion that its planes did not keep clear all along.

A plane that holds at the nodes of its piece is crossed in between by as much as the vertices' paths bulge beyond their
chords: the *sag*. It is measured on the last motion and becomes the margin of the next; the proof is left to `verify`.
"""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.motion.motion import Motion
from pyrobocop_pyomo.motion.moving_shapes import MovingShape, moving_shapes
from pyrobocop_pyomo.motion.safety_report import BodyPairSafety, SafetyReport

from .pieces import Piece, PlaneIndex

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]

# The next motion is another one: a sag counts this many times.
SAG_FACTOR = 1.25
SAMPLES_PER_PIECE = 33
# A plane whose piece is this small a part of its interval is not split any more.
SMALLEST_PART = 1.0 / 32.0


def tighten(block: Any, report: SafetyReport, *, split: bool) -> list[str]:
    """Ask for more where a motion is not proven to be clear.

    Parameters
    ----------
    block : ObstacleAvoidanceBlockData
        Its variables hold the motion.
    report : SafetyReport
        Of that motion, by this block.
    split : bool
        Whether planes are split where margins alone have not helped.

    Returns
    -------
    list of str
        What was done, in words; empty where nothing is left to be done.
    """
    record = block.record
    if not record.per_interval:
        return _brought_back(block, report)
    done: dict[str, int] = {}
    paths = _Paths(record, block.motion)
    sags = {index: paths.sag(piece, _normal(block, index)) for index, piece in record.pieces.items()}
    unsafe: dict[PlaneIndex, float] = {}
    for pair in report.body_pairs:
        for interval in pair.unproven:
            bodies = (record.scene.parts[name].body for name in (pair.first, pair.second))
            back = block.restore(*bodies, interval)
            if back:
                done["left-out planes brought back"] = done.get("left-out planes brought back", 0) + len(back)
                continue
            missing = pair.clearance - float(np.nan_to_num(pair.interval_distance[interval], nan=pair.clearance))
            unsafe |= {piece.index: missing for piece in _pieces(record, pair, interval)}
    for index, sag in sags.items():
        before = value(block.margin[index])
        wanted = SAG_FACTOR * sag
        if index in unsafe:
            # The sag alone was not enough last time, or its plane is not the one that the distance is measured to.
            wanted = max(wanted, before + unsafe[index])
        if wanted > before:
            block.set_margin(*index, wanted)
            done["margins raised"] = done.get("margins raised", 0) + 1
    if split:
        count = sum(_split(block, index, paths) for index in unsafe)
        if count:
            done["planes split"] = count
    words = [f"{count} {what}" for what, count in done.items()]
    logger.info("'%s': %s", block.name, ", ".join(words) or "nothing left to tighten")
    return words


def tighten_containment(region: Any, report: SafetyReport) -> list[str]:
    """Ask for more where a motion leaves a region between the times at which corners are looked at.

    Parameters
    ----------
    region : ContainmentData
    report : SafetyReport
        Of the motion that its variables hold.

    Returns
    -------
    list of str
        What was done, in words; empty where nothing is left to be done.
    """
    intervals = region.motion.intervals
    missing = np.zeros(len(intervals))
    for pair in report.body_pairs if intervals else ():
        # Where nothing was found, only the proof is missing: what it misses will do.
        found = np.fmin(np.nan_to_num(pair.interval_distance, nan=np.inf), pair.clearance - pair.tolerance)
        open_ones = pair.interval_proven < pair.clearance - pair.tolerance
        missing = np.maximum(missing, np.where(open_ones, pair.clearance - found, 0.0))
    for interval in np.flatnonzero(missing).tolist():
        before = max(value(region.margin[time]) for time in intervals[interval])
        region.set_margin(interval, before + SAG_FACTOR * float(missing[interval]))
    count = int(np.count_nonzero(missing))
    words = [f"{count} margins to a region raised"] if count else []
    logger.info("'%s': %s", region.name, ", ".join(words) or "nothing left to tighten")
    return words


def _brought_back(block: Any, report: SafetyReport) -> list[str]:
    """Certificates of single times say nothing about what is between: only those that were left out can be added."""
    record, motion = block.record, block.motion
    parts, count = record.scene.parts, 0
    for pair in report.body_pairs:
        bodies = (parts[pair.first].body, parts[pair.second].body)
        for place in pair.unproven:
            times = motion.intervals[place] if motion.intervals else (motion.points[place],)
            count += sum(len(block.restore(*bodies, time)) for time in times)
    words = [f"{count} left-out certificates brought back"] if count else []
    logger.info("'%s': %s", block.name, ", ".join(words) or "nothing left to tighten")
    return words


def split_violated(block: Any, tolerance: float = 1e-6) -> int:
    """Split the planes that do not hold at the current values: a plane may have to see too long a step.

    Returns
    -------
    int
        How many were split.
    """
    if not block.record.per_interval:
        return 0
    gaps = block.certificate_gaps()
    violated = [index for index, gap in gaps.items() if gap < value(block.required[index]) - tolerance]
    paths = _Paths(block.record, block.motion)
    return sum(_split(block, index, paths) for index in violated)


class _Paths:
    """Paths of the corners of all parts."""

    def __init__(self, record: Any, motion: Motion) -> None:
        bodies = {name: record.scene.bodies[name] for pair in record.scene.pairs for name in pair}
        shapes = moving_shapes(motion, bodies)
        self._shapes = {shape.name: shape for parts in shapes.values() for shape in parts}

    def sag(self, piece: Piece, normal: Array) -> float:
        """By how much the motion bulges beyond what the poses of a plane show, along its normal."""
        length = np.linalg.norm(normal)
        if not 0.0 < length < np.inf:  # a plane without normal shows nothing
            return 0.0
        direction = normal / length
        first, second = (self._shapes[name] for name in (piece.first, piece.second))
        return self._bulge(first, piece, -direction) + self._bulge(second, piece, direction)

    def _bulge(self, shape: MovingShape, piece: Piece, direction: Array) -> float:
        """How much farther a shape reaches along a direction than at the poses of the piece."""
        if shape.template is None:
            return 0.0
        dense = np.linspace(piece.fractions[0], piece.fractions[-1], SAMPLES_PER_PIECE)
        farthest = []
        for fractions in (dense, np.array(piece.fractions)):
            corners, _ = shape.corners(np.full(len(fractions), piece.interval), fractions)
            farthest.append(float((corners @ direction).max()))
        return max(farthest[0] - farthest[1], 0.0)


def _pieces(record: Any, pair: BodyPairSafety, interval: int) -> list[Piece]:
    pieces: list[Piece] = record.pieces_of(pair.first, pair.second)
    return [piece for piece in pieces if piece.interval == interval]


def _split(block: Any, index: PlaneIndex, paths: _Paths) -> bool:
    piece = block.record.pieces[index]
    if piece.fractions[-1] - piece.fractions[0] <= SMALLEST_PART:
        return False
    for half in block.split(*index):
        # Its motion bulges less than that of the whole.
        block.set_margin(*half, SAG_FACTOR * paths.sag(block.record.pieces[half], _normal(block, half)))
    return True


def _normal(block: Any, index: PlaneIndex) -> Array:
    return np.array([value(block.normal[(*index, axis)]) for axis in block.axes], dtype=float)
