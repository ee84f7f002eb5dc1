"""Certificates as variables and rows: adding them, taking them off again, and letting them miss by a slack."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pyomo.core.base.set import Set

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose
from pyrobocop_pyomo.motion.motion import Motion

from .avoidance_record import AvoidanceRecord
from .formulations import Side
from .pieces import Piece, PlaneIndex
from .scene import Part


def add_poses(record: AvoidanceRecord, motion: Motion, pieces: Iterable[Piece]) -> None:
    """Make the expressions of the poses at all times of the pieces, each once for all pairs.

    Raises
    ------
    ObstacleError
        When a rule returns no pose, or one that does not fit its body.
    """
    scene = record.scene
    for piece in pieces:
        for name in {scene.parts[piece.first].body, scene.parts[piece.second].body}:
            rule = scene.bodies[name].pose
            if rule is None:
                record.poses.setdefault((name, None), Pose.identity(record.dimension))
                continue
            for position, time in enumerate(piece.times):
                if (name, time) not in record.poses:
                    pose = piece.pose_at(motion, rule, position, name)
                    record.poses[name, time] = _checked(pose, name, time, record.dimension)


def _checked(pose: Any, name: str, time: Any, dimension: int) -> Pose:
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


def add_certificate(block: Any, record: AvoidanceRecord, piece: Piece) -> None:
    """Add variables and rows of the certificate of a piece, whose poses are there already."""
    index = piece.index
    block.planes.add(index)
    record.pieces[index] = piece
    if record.soft:
        block.slack.add(index).set_value(0.0)
    block.required.add(index, _requirement(block, record, piece))
    first, second = record.scene.parts[piece.first], record.scene.parts[piece.second]
    record.formulation.add(block, index, _side(record, first, piece), _side(record, second, piece))
    if record.norm_now != "ball":
        record.formulation.set_norm(block, index, record.norm_now)


def _side(record: AvoidanceRecord, part: Part, piece: Piece) -> Side:
    if record.scene.is_static(part.body):
        return Side(part.shape, ((piece.times[0], record.poses[part.body, None]),))
    return Side(part.shape, tuple((time, record.poses[part.body, time]) for time in piece.times))


def _requirement(block: Any, record: AvoidanceRecord, piece: Piece) -> Any:
    """Separation to be proven: clearance, radii and margin, less the slack."""
    first, second = record.scene.parts[piece.first], record.scene.parts[piece.second]
    asked = block.clearance[first.body, second.body] * block.clearance_scale + block.margin[piece.index]
    radii = first.shape.radius + second.shape.radius
    total = asked + radii if radii else asked
    return total - block.slack[piece.index] if record.soft else total


def remove_certificate(block: Any, record: AvoidanceRecord, piece: Piece) -> None:
    """Take everything that belongs to a certificate off the block."""
    index = piece.index
    for component in block.component_map().values():
        if component.is_indexed() and component.ctype is not Set:
            for key in [key for key in component._data if _belongs(key, index)]:
                del component[key]
    block.planes.remove(index)
    del record.pieces[index]


def _belongs(key: Any, index: PlaneIndex) -> bool:
    """Indices of members start with the one of their certificate; some have a word before it."""
    return isinstance(key, tuple) and (key[:3] == index or key[1:4] == index)


def soften(block: Any, record: AvoidanceRecord) -> None:
    """Give every certificate a slack."""
    record.soft = True
    for index, piece in record.pieces.items():
        block.slack.add(index).set_value(0.0)
        block.required[index].set_value(_requirement(block, record, piece))
    update_softness(block, record)


def harden(block: Any, record: AvoidanceRecord) -> None:
    """Take the slack away again."""
    record.soft = False
    for index, piece in record.pieces.items():
        block.required[index].set_value(_requirement(block, record, piece))
    update_softness(block, record)
    block.slack.clear()


def update_softness(block: Any, record: AvoidanceRecord) -> None:
    """Cost of the slack that there is now."""
    slacks = sum(block.slack[index] for index in record.pieces) if record.soft else 0.0
    block.softness.set_value(block.softness_weight * slacks if record.soft else 0.0)
