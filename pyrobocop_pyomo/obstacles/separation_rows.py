"""Separations as variables and rows: adding and removing them, their start values; both shapes by their corners.

A plane has a normal ``n`` and an offset ``c``. Its rows, for corners ``V_i`` of the first and ``W_j`` of the second
shape at every pose ``(R, t)`` that it covers::

    n.(R1 V_i + t1) >= c + required        n.(R2 W_j + t2) <= c        n.n <= 1 or n.n = 1

Rays ``r`` of unbounded shapes add ``n.R1 r >= 0`` and ``n.R2 r <= 0``. An ellipsoid ``V + B u, |u| <= 1`` takes
``|B'R1'n|`` off the left side, or adds it in the second row. For two shapes in the plane with v and w
corners that is 3 variables and v + w + 1 rows per pose (Fan, Murgovski & Liang, arXiv:2312.17440).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.set import Set
from pyomo.core.expr import sqrt
from pyomo.core.expr.numeric_expr import MonomialTermExpression, ProductExpression, SumExpression
from pyomo.core.expr.numvalue import is_fixed, value
from pyomo.core.expr.relational_expr import InequalityExpression

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, Pose
from pyrobocop_pyomo.geometry.poses import dot, is_number
from pyrobocop_pyomo.modeling.pyomo_internals import new_row, parts_of
from pyrobocop_pyomo.motion.motion import Motion
from pyrobocop_pyomo.motion.rules_along_motion import (
    RuleAlongMotion,
    clearance_along,
    clearance_value,
    is_clearance_rule,
    pose_along,
)

from .avoidance_record import AvoidanceRecord, MotionSegment
from .scene import SeparationIndex, is_length


def add_poses(record: AvoidanceRecord, motion: Motion, segments: Iterable[MotionSegment]) -> None:
    """Make the expressions of the poses, and of clearances that change, at all times of the segments.

    Poses are made once for all body pairs.

    Raises
    ------
    ObstacleError
        When a rule returns no pose, or one of another dimension than its body.
    """
    bodies = record.scene.bodies
    rules = {name: pose_along(motion, body.pose, name) for name, body in bodies.items() if body.moves}
    rules_of_pairs = {
        pair: clearance_along(motion, rule, pair) for pair, rule in record.clearances.items() if is_clearance_rule(rule)
    }
    for segment in segments:
        pair = record.body_pair(segment)
        for name in pair:
            if name not in rules:
                record.poses.setdefault((name, None), Pose.identity(record.dimension))
            for position, time in enumerate(segment.times if name in rules else ()):
                if (name, time) not in record.poses:
                    pose = _said(rules[name], segment, position)
                    if pose.dimension != record.dimension:
                        raise ObstacleError(
                            f"'{name}' has {record.dimension} dimensions and its pose at {time} has {pose.dimension}. "
                            "Use planar_pose in the plane and spatial_pose in space."
                        )
                    record.poses[name, time] = pose
        for position, time in enumerate(segment.times if pair in rules_of_pairs else ()):
            if (*pair, time) not in record.lengths:
                length = _said(rules_of_pairs[pair], segment, position)
                what = rules_of_pairs[pair].label
                if is_fixed(length) and not is_length(clearance_value(length, what)):
                    raise ObstacleError(f"{what} at t = {time!r} is {value(length):g}; it must be a length > 0.")
                record.lengths[(*pair, time)] = length


def _said(rule: RuleAlongMotion, segment: MotionSegment, position: int) -> Any:
    """What a rule says at one of the times of a segment."""
    if segment.interval is None:
        return rule.at_node(segment.times[position])
    return rule.at(segment.interval, segment.fractions[position])


def add_separation(block: Any, record: AvoidanceRecord, segment: MotionSegment) -> None:
    """Add variables and rows of the separation of a segment, whose poses exist already."""
    index, pair, scene = segment.index, record.body_pair(segment), record.scene
    block.separations.add(index)
    record.segments[index] = segment
    first, second = scene.parts[segment.first], scene.parts[segment.second]
    lengths = [record.clearance_at(pair, time) for time in segment.times]
    radii = first.shape.radius + second.shape.radius
    gap = lengths[0] + block.margin[index]
    block.required.add(index, gap + radii if radii else gap)
    normal = [block.normal.add((*index, axis)) for axis in block.axes]
    offset = block.offset.add(index)
    # What a rule asks for at other times than the first grows one of the shapes that move.
    rising = None
    if is_clearance_rule(record.clearances[pair]):
        rising = second if scene.is_static(first.body) else first
    for name, rows, part, height in (
        ("first", block.first_shape, first, offset + block.required[index]),
        ("second", block.second_shape, second, offset),
    ):
        rests, upward = scene.is_static(part.body), part is first
        for position, time in enumerate(segment.times[:1] if rests else segment.times):
            pose, place = record.poses[part.body, None if rests else time], (*index, time)
            rise = lengths[position] - lengths[0] if part is rising and position > 0 else 0.0
            moved = height + rise if upward else height - rise
            level = block.level.add((name, *place), dot(normal, pose.translation) - moved)
            if all(is_number(entry) for row in pose.rotation for entry in row):
                rotation = np.array(pose.rotation, dtype=float)
                shape, direction = part.shape.swept([(rotation, np.zeros(len(rotation)))]), normal
            else:
                shape = part.shape
                direction = [
                    block.rotated_normal.add((name, *place, axis), entry)
                    # R'n: the direction in the frame of the body
                    for axis, entry in enumerate(dot(column, normal) for column in zip(*pose.rotation, strict=True))
                ]
            _state_side(rows, place, shape, direction, level, upward=upward)
    block.unit.add(index, norm_relation(normal, record.norm_now))


def remove_separations(block: Any, record: AvoidanceRecord, segments: Iterable[MotionSegment]) -> None:
    """Remove all members of separations from the block."""
    removed = {segment.index for segment in segments}
    if not removed:
        return
    for component in block.component_map().values():
        if component.is_indexed() and component.ctype is not Set:
            for key in [key for key in parts_of(component) if _belongs(key, removed)]:
                del component[key]
    for index in removed:
        block.separations.remove(index)
        del record.segments[index]


def _belongs(key: Any, separations: Collection[SeparationIndex]) -> bool:
    """Indices of members start with the index of their separation; some have a word before it."""
    return isinstance(key, tuple) and (key[:3] in separations or key[1:4] in separations)


def start_plane(block: Any, index: SeparationIndex, first: Polytope, second: Polytope, normal: np.ndarray) -> None:
    """The given normal, and the plane in the middle of the gap along it."""
    for axis, number in enumerate(normal.tolist()):
        block.normal[(*index, axis)].set_value(number, skip_validation=True)
    # The required clearance holds both paddings.
    upper = float(first.lowest(normal[None])[0]) + first.radius - value(block.required[index])
    lower = float(second.highest(normal[None])[0]) - second.radius
    block.offset[index].set_value((upper + lower) / 2, skip_validation=True)


def normal_of(block: Any, index: SeparationIndex) -> np.ndarray:
    """The normal (d,) of a separation; NaN where it has no value."""
    entries = [value(block.normal[(*index, axis)], exception=False) for axis in block.axes]
    return np.array(entries, dtype=float)


def unit_normal_of(block: Any, index: SeparationIndex) -> np.ndarray | None:
    """The normal of a separation made to have length one; None where it cannot be."""
    normal = normal_of(block, index)
    length = float(np.linalg.norm(normal))
    return normal / length if np.isfinite(length) and length > 0.0 else None


def _state_side(
    rows: Constraint,
    place: tuple[Any, ...],
    shape: Polytope,
    direction: Sequence[Any],
    level: Any,
    *,
    upward: bool,
) -> None:
    """Rows that keep corners, and rays from them, on one side of a plane at a height over a body's origin.

    The direction consists of variables and named expressions, and the level is one. Pyomo's operators and `add` take
    nearly twice as long, and these rows much of the time of a scene.
    """
    products = [MonomialTermExpression if entry.is_variable_type() else ProductExpression for entry in direction]
    heights: list[Any] = []
    for corner, ellipsoid in shape.corners:
        parts = (of((c, e)) for of, c, e in zip(products, corner, direction, strict=True) if c)
        height = SumExpression([*parts, level])
        extent = 0.0 if ellipsoid is None else extent_along(direction, ellipsoid)
        heights.append(height if ellipsoid is None else height - extent if upward else height + extent)
    heights += [dot(ray, direction) for ray in shape.rays.tolist()]
    for number, height in enumerate(heights):
        sides = (0.0, height) if upward else (height, 0.0)
        new_row(rows, (*place, number), InequalityExpression(sides, False))


def extent_along(direction: Sequence[Any], ellipsoid: np.ndarray) -> Any:
    """How far an ellipsoid (d, d) reaches from its middle along a direction of expressions."""
    return sqrt(sum(dot(column, direction) ** 2 for column in ellipsoid.T.tolist()))


def norm_relation(normal: Sequence[Any], norm: str) -> tuple[Any, Any, Any]:
    """The relation that bounds ("ball") or fixes ("sphere") the length of the normal."""
    square = sum(entry**2 for entry in normal)
    return (1.0, square, 1.0) if norm == "sphere" else (None, square, 1.0)
