"""Planes that separate two shapes: variables, rows, start values; both shapes by their vertices.

A plane has a normal ``n`` and an offset ``c``. Its rows, for vertices ``V_i`` of the first and ``W_j`` of the second
shape at every pose ``(R, t)`` that it covers::

    n.(R1 V_i + t1) >= c + required        n.(R2 W_j + t2) <= c        n.n <= 1 or n.n = 1

Rays ``r`` of unbounded shapes add ``n.R1 r >= 0`` and ``n.R2 r <= 0``. For two shapes in the plane with v and w
vertices that is 3 variables and v + w + 1 rows per pose (Fan, Murgovski & Liang, arXiv:2312.17440).
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.expression import Expression
from pyomo.core.base.set import Any as AnyIndex
from pyomo.core.base.var import Var
from pyomo.core.expr.numeric_expr import MonomialTermExpression, ProductExpression, SumExpression
from pyomo.core.expr.numvalue import value
from pyomo.core.expr.relational_expr import InequalityExpression

from pyrobocop_pyomo.geometry import Polytope, Pose
from pyrobocop_pyomo.geometry.poses import dot, is_number
from pyrobocop_pyomo.modeling.bulk_parts import new_row

SeparationIndex = tuple[str, str, Hashable]

# Bounds of 1 would be active for normals along an axis, where the norm is active too: multipliers are then not unique,
# and solvers take three times as many iterations.
WIDER_THAN_ONE = (-1.5, 1.5)


@dataclass(frozen=True)
class PosedShape:
    """One of the two shapes of a separation, with the poses that the separation covers.

    Attributes
    ----------
    shape : Polytope
    poses : tuple of (float, Pose)
        One entry per time; a single one, with a constant pose, for a shape that rests.
    rises : tuple
        How much more than ``required[index]`` is requested at each of these times, at one of the two shapes; empty
        where it is the same at all.
    """

    shape: Polytope
    poses: tuple[tuple[Hashable, Pose], ...]
    rises: tuple[Any, ...] = ()


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
    normal = [block.normal.add((*index, axis)) for axis in range(first.shape.dimension)]
    offset = block.offset.add(index)
    required = block.required[index]
    for name, rows, posed, extra, upward in (
        ("first", block.first_shape, first, offset + required, True),
        ("second", block.second_shape, second, offset, False),
    ):
        rises = posed.rises or (0.0,) * len(posed.poses)
        for (time, pose), rise in zip(posed.poses, rises, strict=True):
            place = (*index, time)
            moved = extra + rise if upward else extra - rise
            level = block.level.add((name, *place), dot(normal, pose.translation) - moved)
            if all(is_number(entry) for row in pose.rotation for entry in row):
                rotation = np.array(pose.rotation, dtype=float)
                corners, rays = posed.shape.vertices @ rotation.T, posed.shape.rays @ rotation.T
                direction = normal
            else:
                corners, rays = posed.shape.vertices, posed.shape.rays
                direction = [
                    block.turned_normal.add((name, *place, axis), entry)
                    # R'n: the direction in the frame of the body
                    for axis, entry in enumerate(dot(column, normal) for column in zip(*pose.rotation, strict=True))
                ]
            _state_side(rows, place, corners, rays, direction, level, upward=upward)
    block.unit.add(index, _norm_relation(normal, "ball"))


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
