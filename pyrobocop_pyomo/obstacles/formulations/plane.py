"""A plane between the shapes: both shapes by their vertices, the plane by its normal and offset."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from .protocol import PlacedShape, PosedShape, SeparationIndex
from .rows import (
    add_components,
    dot,
    empty_expressions,
    empty_rows,
    has_constant_rotation,
    norm_relation,
    rotation_of,
    set_norm,
    state_side,
    turned,
)

# Bounds of 1 would be active for normals along an axis, where the norm is active too: multipliers are then not unique,
# and solvers take three times as many iterations.
WIDER_THAN_ONE = (-1.5, 1.5)


@dataclass(frozen=True)
class Plane:
    """Separating plane ``(n, c)``: the first shape on one side with the gap required, the second on the other.

    Rows, for vertices ``V_i`` of the first and ``W_j`` of the second shape at every pose ``(R, t)`` covered::

        n.(R1 V_i + t1) >= c + required        n.(R2 W_j + t2) <= c        n.n <= 1 or n.n = 1

    Rays ``r`` of unbounded shapes add ``n.R1 r >= 0`` and ``n.R2 r <= 0``. For two shapes in the plane with v and w
    vertices that is 3 variables and v + w + 1 rows per pose.

    References
    ----------
    Fan, Murgovski & Liang, arXiv:2312.17440
    """

    name: str = "plane"
    covers_intervals: bool = True
    signed: bool = True
    norms: tuple[str, ...] = ("ball", "sphere")
    halfspaces: tuple[bool, bool] = (False, False)
    rays: tuple[bool, bool] = (True, True)

    def declare(self, block: Any, axes: range) -> None:
        """Normal, offset and their rows, still empty."""
        add_components(
            block,
            normal=Var(block.separations, list(axes), bounds=WIDER_THAN_ONE, dense=False, doc="normal of each plane"),
            offset=Var(block.separations, dense=False, doc="offset of each plane"),
            turned_normal=empty_expressions("normals in the frame of a body that turns"),
            level=empty_expressions("height of a body's origin over the plane"),
            first_shape=empty_rows("vertices of the first shape: beyond the plane by what is required"),
            second_shape=empty_rows("vertices of the second shape: behind the plane"),
            unit=empty_rows("length of the normal"),
        )

    def add(self, block: Any, index: SeparationIndex, first: PosedShape, second: PosedShape) -> None:
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
                if has_constant_rotation(pose):
                    corners = posed.shape.vertices @ rotation_of(pose).T
                    rays = posed.shape.rays @ rotation_of(pose).T
                    direction = normal
                else:
                    corners, rays = posed.shape.vertices, posed.shape.rays
                    direction = [
                        block.turned_normal.add((name, *place, axis), entry)
                        for axis, entry in enumerate(turned(normal, pose))
                    ]
                state_side(rows, place, corners, rays, direction, level, upward=upward)
        block.unit.add(index, norm_relation(normal, "ball"))

    def start(
        self, block: Any, index: SeparationIndex, first: PlacedShape, second: PlacedShape, normal: np.ndarray
    ) -> None:
        """The given normal, and the plane in the middle of the gap along it."""
        for axis, number in enumerate(normal.tolist()):
            block.normal[(*index, axis)].set_value(number, skip_validation=True)
        upper = float((first.vertices @ normal).min()) - value(block.required[index])
        lower = float((second.vertices @ normal).max())
        block.offset[index].set_value((upper + lower) / 2, skip_validation=True)

    def set_norm(self, block: Any, index: SeparationIndex, norm: str) -> None:
        """Bound the length of the normal, or fix it."""
        set_norm(block, index, norm)
