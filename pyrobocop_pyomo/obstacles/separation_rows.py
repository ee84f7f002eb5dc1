"""Separations as variables and rows: adding and removing them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from pyomo.core.base.set import Set

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose
from pyrobocop_pyomo.modeling.bulk_parts import parts_taken_off
from pyrobocop_pyomo.motion.motion import Motion

from .avoidance_record import AvoidanceRecord, MotionSegment
from .clearances import ClearanceRule, asked_at, length_at
from .planes import PosedShape, SeparationIndex, add_plane, set_norm
from .scene import ConvexPart


def add_poses(record: AvoidanceRecord, motion: Motion, segments: Iterable[MotionSegment]) -> None:
    """Make the expressions of the poses, and of clearances that change, at all times of the segments.

    Poses are made once for all body pairs.

    Raises
    ------
    ObstacleError
        When a rule returns no pose, or one of another dimension than its body.
    """
    for segment in segments:
        pair = _bodies(record, segment)
        for name in pair:
            body = record.scene.bodies[name]
            if not body.moves:
                record.poses.setdefault((name, None), Pose.identity(record.dimension))
                continue
            for position, time in enumerate(segment.times):
                if (name, time) not in record.poses:
                    pose = segment.pose_at(motion, body, position, name)
                    record.poses[name, time] = _checked_pose(pose, name, time, record.dimension)
        asked = record.asked[pair]
        for position, time in enumerate(segment.times) if isinstance(asked, ClearanceRule) else ():
            if (*pair, time) not in record.lengths:
                record.lengths[(*pair, time)] = length_at(motion, asked, pair, segment, position)


def _bodies(record: AvoidanceRecord, segment: MotionSegment) -> tuple[str, str]:
    """Names of the two bodies of a segment."""
    return record.scene.parts[segment.first].body, record.scene.parts[segment.second].body


def _checked_pose(pose: Pose, name: str, time: Any, dimension: int) -> Pose:
    if pose.dimension != dimension:
        raise ObstacleError(
            f"'{name}' has {dimension} dimensions and its pose at {time} has {pose.dimension}. "
            "Use planar_pose in the plane and spatial_pose in space."
        )
    return pose


def add_separation(block: Any, record: AvoidanceRecord, segment: MotionSegment) -> None:
    """Add variables and rows of the separation of a segment, whose poses exist already."""
    index = segment.index
    block.separations.add(index)
    record.segments[index] = segment
    first, second = record.scene.parts[segment.first], record.scene.parts[segment.second]
    pair = _bodies(record, segment)
    lengths = [asked_at(block, pair, time) for time in segment.times]
    radii = first.shape.radius + second.shape.radius
    gap = lengths[0] + block.margin[index]
    block.required.add(index, gap + radii if radii else gap)
    # What a rule asks for at other times than the first grows one of the shapes.
    is_rule = isinstance(record.asked[pair], ClearanceRule)
    rises = (0.0, *(later - lengths[0] for later in lengths[1:])) if is_rule else ()
    rising = second if record.scene.is_static(first.body) else first
    shapes = [_posed(record, part, segment, rises if part is rising else ()) for part in (first, second)]
    add_plane(block, index, *shapes)
    if record.norm_now != "ball":
        set_norm(block, index, record.norm_now)


def _posed(
    record: AvoidanceRecord, part: ConvexPart, segment: MotionSegment, rises: tuple[Any, ...] = ()
) -> PosedShape:
    if record.scene.is_static(part.body):
        return PosedShape(part.shape, ((segment.times[0], record.poses[part.body, None]),))
    poses = tuple((time, record.poses[part.body, time]) for time in segment.times)
    return PosedShape(part.shape, poses, rises)


def remove_separations(block: Any, record: AvoidanceRecord, segments: Iterable[MotionSegment]) -> None:
    """Remove all members of separations from the block."""
    removed = {segment.index for segment in segments}
    if not removed:
        return
    for component in block.component_map().values():
        if component.is_indexed() and component.ctype is not Set:
            for key in [key for key in component._data if _belongs(key, removed)]:
                del component[key]
    for index in removed:
        block.separations.remove(index)
        del record.segments[index]


@contextmanager
def members_taken_off(block: Any) -> Iterator[list[Any]]:
    """Take the variables and rows of all separations off the block for a while, as for a copy; yields them.

    What the broad phase has left out is off the record meanwhile: a copy for other times makes its own.
    """
    record, pruned = block.record, block.record.pruned
    remaining = [
        (each, {key: part for key, part in each._data.items() if not _belongs(key, record.segments)})
        for each in block.component_map().values()
        if each.is_indexed() and each.ctype is not Set
    ]
    try:
        record.pruned = {}
        with parts_taken_off(remaining) as taken:
            yield taken
    finally:
        record.pruned = pruned


def _belongs(key: Any, separations: Collection[SeparationIndex]) -> bool:
    """Indices of members start with the index of their separation; some have a word before it."""
    return isinstance(key, tuple) and (key[:3] in separations or key[1:4] in separations)
