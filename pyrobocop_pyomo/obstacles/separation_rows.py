"""Separations as variables and rows: adding, removing, softening and hardening them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pyomo.core.base.set import Set

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose
from pyrobocop_pyomo.motion.motion import Motion

from .avoidance_record import AvoidanceRecord, MotionSegment
from .formulations import PosedShape, SeparationIndex
from .scene import ConvexPart


def add_poses(record: AvoidanceRecord, motion: Motion, segments: Iterable[MotionSegment]) -> None:
    """Make the expressions of the poses at all times of the segments, once for all body pairs.

    Raises
    ------
    ObstacleError
        When a rule returns no pose, or one of another dimension than its body.
    """
    scene = record.scene
    for segment in segments:
        for name in {scene.parts[segment.first].body, scene.parts[segment.second].body}:
            rule = scene.bodies[name].pose
            if rule is None:
                record.poses.setdefault((name, None), Pose.identity(record.dimension))
                continue
            for position, time in enumerate(segment.times):
                if (name, time) not in record.poses:
                    pose = segment.pose_at(motion, rule, position, name)
                    record.poses[name, time] = _checked_pose(pose, name, time, record.dimension)


def _checked_pose(pose: Any, name: str, time: Any, dimension: int) -> Pose:
    if not isinstance(pose, Pose):
        raise ObstacleError(
            f"the pose rule of '{name}' returned {pose!r} at {time}; expected a Pose: return planar_pose(x, y, theta) "
            "in the plane, spatial_pose(...) in space."
        )
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
    if record.soft:
        block.slack.add(index).set_value(0.0)
    block.required.add(index, _required_gap(block, record, segment))
    first, second = record.scene.parts[segment.first], record.scene.parts[segment.second]
    record.formulation.add(block, index, _posed(record, first, segment), _posed(record, second, segment))
    if record.norm_now != "ball":
        record.formulation.set_norm(block, index, record.norm_now)


def _posed(record: AvoidanceRecord, part: ConvexPart, segment: MotionSegment) -> PosedShape:
    if record.scene.is_static(part.body):
        return PosedShape(part.shape, ((segment.times[0], record.poses[part.body, None]),))
    return PosedShape(part.shape, tuple((time, record.poses[part.body, time]) for time in segment.times))


def _required_gap(block: Any, record: AvoidanceRecord, segment: MotionSegment) -> Any:
    """Clearance, radii and margin, less the slack."""
    first, second = record.scene.parts[segment.first], record.scene.parts[segment.second]
    asked = block.clearance[first.body, second.body] * block.clearance_scale + block.margin[segment.index]
    radii = first.shape.radius + second.shape.radius
    total = asked + radii if radii else asked
    return total - block.slack[segment.index] if record.soft else total


def remove_separation(block: Any, record: AvoidanceRecord, segment: MotionSegment) -> None:
    """Remove all members of a separation from the block."""
    index = segment.index
    for component in block.component_map().values():
        if component.is_indexed() and component.ctype is not Set:
            for key in [key for key in component._data if _belongs(key, index)]:
                del component[key]
    block.separations.remove(index)
    del record.segments[index]


def _belongs(key: Any, index: SeparationIndex) -> bool:
    """Indices of members start with the index of their separation; some have a word before it."""
    return isinstance(key, tuple) and (key[:3] == index or key[1:4] == index)


def soften(block: Any, record: AvoidanceRecord) -> None:
    """Give every separation a slack."""
    record.soft = True
    for index, segment in record.segments.items():
        block.slack.add(index).set_value(0.0)
        block.required[index].set_value(_required_gap(block, record, segment))
    update_softness(block, record)


def harden(block: Any, record: AvoidanceRecord) -> None:
    """Remove the slack again."""
    record.soft = False
    for index, segment in record.segments.items():
        block.required[index].set_value(_required_gap(block, record, segment))
    update_softness(block, record)
    block.slack.clear()


def update_softness(block: Any, record: AvoidanceRecord) -> None:
    """Update the cost of the slack after separations were added or removed."""
    slacks = sum(block.slack[index] for index in record.segments) if record.soft else 0.0
    block.softness.set_value(block.softness_weight * slacks if record.soft else 0.0)
