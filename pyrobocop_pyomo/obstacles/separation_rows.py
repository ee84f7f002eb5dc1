"""Separations as variables and rows: adding and removing them, their start values; both shapes by their vertices.

A plane has a normal ``n`` and an offset ``c``. Its rows, for vertices ``V_i`` of the first and ``W_j`` of the second
shape at every pose ``(R, t)`` that it covers::

    n.(R1 V_i + t1) >= c + required        n.(R2 W_j + t2) <= c        n.n <= 1 or n.n = 1

Rays ``r`` of unbounded shapes add ``n.R1 r >= 0`` and ``n.R2 r <= 0``. For two shapes in the plane with v and w
vertices that is 3 variables and v + w + 1 rows per pose (Fan, Murgovski & Liang, arXiv:2312.17440).
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.expression import Expression
from pyomo.core.base.set import Any as AnyIndex
from pyomo.core.base.set import Set
from pyomo.core.base.var import Var
from pyomo.core.expr.numeric_expr import MonomialTermExpression, ProductExpression, SumExpression
from pyomo.core.expr.numvalue import value
from pyomo.core.expr.relational_expr import InequalityExpression

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, Pose
from pyrobocop_pyomo.geometry.poses import dot, is_number
from pyrobocop_pyomo.modeling.bulk_parts import new_row, parts_taken_off
from pyrobocop_pyomo.motion.motion import Motion

from .avoidance_record import AvoidanceRecord, MotionSegment
from .clearances import ClearanceRule, asked_at, length_at
from .scene import ConvexPart, SeparationIndex

# One of the two shapes of a separation, with the times that it covers (one for a shape that rests), the pose at each,
# and how much more than ``required[index]`` is requested there.
PosedShape = tuple[Polytope, list[tuple[Hashable, Pose, Any]]]

# Bounds of 1 would be active for normals along an axis, where the norm is active too: multipliers are then not unique,
# and solvers take three times as many iterations.
WIDER_THAN_ONE = (-1.5, 1.5)


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
            for position, time in enumerate(segment.times if body.moves else ()):
                if (name, time) not in record.poses:
                    record.poses[name, time] = _pose(motion, body, name, segment, position)
        asked = record.asked[pair]
        for position, time in enumerate(segment.times) if isinstance(asked, ClearanceRule) else ():
            if (*pair, time) not in record.lengths:
                record.lengths[(*pair, time)] = length_at(motion, asked, pair, segment, position)


def _pose(motion: Motion, body: Any, name: str, segment: MotionSegment, position: int) -> Pose:
    time = segment.times[position]
    if segment.interval is None:
        pose = motion.pose_at_node(body.pose, time, name=name)
    else:
        pose = motion.pose_at(body.pose, segment.interval, segment.fractions[position], name=name)
    if pose.dimension != body.dimension:
        raise ObstacleError(
            f"'{name}' has {body.dimension} dimensions and its pose at {time} has {pose.dimension}. "
            "Use planar_pose in the plane and spatial_pose in space."
        )
    return pose


def _bodies(record: AvoidanceRecord, segment: MotionSegment) -> tuple[str, str]:
    """Names of the two bodies of a segment."""
    return record.scene.parts[segment.first].body, record.scene.parts[segment.second].body


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


def _posed(
    record: AvoidanceRecord, part: ConvexPart, segment: MotionSegment, rises: tuple[Any, ...] = ()
) -> PosedShape:
    rests = record.scene.is_static(part.body)
    times = segment.times[:1] if rests else segment.times
    poses = [record.poses[part.body, None if rests else time] for time in times]
    return part.shape, list(zip(times, poses, rises or (0.0,) * len(times), strict=True))


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


# ------------------------------------------------------------------------------------------------------ the planes


def declare_planes(block: Any) -> None:
    """Normal, offset and their rows, still empty."""
    block.normal = Var(block.separations, list(block.axes), bounds=WIDER_THAN_ONE, dense=False, doc="normals of planes")
    block.offset = Var(block.separations, dense=False, doc="offsets of planes")
    block.turned_normal = Expression(AnyIndex, doc="normals in the frame of a body that turns")
    block.level = Expression(AnyIndex, doc="height of a body's origin over the plane")
    block.first_shape = Constraint(AnyIndex, doc="vertices of the first shape: beyond the plane by what is required")
    block.second_shape = Constraint(AnyIndex, doc="vertices of the second shape: behind the plane")
    block.unit = Constraint(AnyIndex, doc="length of the normal")


def add_plane(block: Any, index: SeparationIndex, first: PosedShape, second: PosedShape) -> None:
    """Variables and rows of one plane."""
    normal = [block.normal.add((*index, axis)) for axis in block.axes]
    offset = block.offset.add(index)
    required = block.required[index]
    for name, rows, (shape, poses), extra, upward in (
        ("first", block.first_shape, first, offset + required, True),
        ("second", block.second_shape, second, offset, False),
    ):
        for time, pose, rise in poses:
            place = (*index, time)
            moved = extra + rise if upward else extra - rise
            level = block.level.add((name, *place), dot(normal, pose.translation) - moved)
            if all(is_number(entry) for row in pose.rotation for entry in row):
                rotation = np.array(pose.rotation, dtype=float)
                corners, rays = shape.vertices @ rotation.T, shape.rays @ rotation.T
                direction = normal
            else:
                corners, rays = shape.vertices, shape.rays
                direction = [
                    block.turned_normal.add((name, *place, axis), entry)
                    # R'n: the direction in the frame of the body
                    for axis, entry in enumerate(dot(column, normal) for column in zip(*pose.rotation, strict=True))
                ]
            _state_side(rows, place, corners, rays, direction, level, upward=upward)
    block.unit.add(index, _norm_relation(normal, block.record.norm_now))


def start_plane(block: Any, index: SeparationIndex, first: Polytope, second: Polytope, normal: np.ndarray) -> None:
    """The given normal, and the plane in the middle of the gap along it."""
    for axis, number in enumerate(normal.tolist()):
        block.normal[(*index, axis)].set_value(number, skip_validation=True)
    upper = float((first.vertices @ normal).min()) - value(block.required[index])
    lower = float((second.vertices @ normal).max())
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


def set_norm(block: Any, index: SeparationIndex, norm: str) -> None:
    """Bound the length of the normal, or fix it."""
    block.unit[index].set_value(_norm_relation([block.normal[(*index, axis)] for axis in block.axes], norm))


def _state_side(
    rows: Constraint,
    place: tuple[Any, ...],
    corners: np.ndarray,
    rays: np.ndarray,
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
    heights: list[Any] = [
        SumExpression([*(of((c, e)) for of, c, e in zip(products, corner, direction, strict=True) if c), level])
        for corner in corners.tolist()
    ]
    heights += [dot(ray, direction) for ray in rays.tolist()]
    for number, height in enumerate(heights):
        sides = (0.0, height) if upward else (height, 0.0)
        new_row(rows, (*place, number), InequalityExpression(sides, False))


def _norm_relation(normal: Sequence[Any], norm: str) -> tuple[Any, Any, Any]:
    """The relation that bounds ("ball") or fixes ("sphere") the length of the normal."""
    square = sum(entry**2 for entry in normal)
    return (1.0, square, 1.0) if norm == "sphere" else (None, square, 1.0)
