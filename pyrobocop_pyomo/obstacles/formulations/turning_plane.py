"""A plane that turns and moves between the shapes during an interval: its normal and offset are linear in time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.geometry import distance_of_points

from .plane import WIDER_THAN_ONE
from .protocol import PlacedShape, PosedShape, SeparationIndex
from .rows import add_components, dot, empty_expressions, empty_rows, norm_relation, state_side, turned

_ENDS = (0, 1)


@dataclass(frozen=True)
class TurningPlane:
    """Separating plane whose normal and offset are linear in time over the segment of motion that it covers.

    With the local time ``s`` of each pose, from 0 at the start of the segment to 1 at its end::

        n(s) = (1 - s) n0 + s n1        c(s) = (1 - s) c0 + s c1
        n(s).(R1 V_i + t1) >= c(s) + required        n(s).(R2 W_j + t2) <= c(s)        |n0|, |n1| <= 1 or = 1

    ``|n(s)| <= 1`` then holds in between as well, so that the gap required is a lower bound of the distance at each
    pose. A shape that rests has rows at both ends. For two shapes in the plane with v and w vertices that is 6
    variables, v + w rows per pose and 2 more.

    `normal` is the mean of both ends.

    References
    ----------
    Amice, Werner & Tedrake, Certifying Bimanual RRT Motion Plans in a Second, arXiv:2310.16603: separating planes that
    are polynomials along a path
    """

    name: str = "turning plane"
    covers_intervals: bool = True
    signed: bool = True
    norms: tuple[str, ...] = ("ball", "sphere")
    halfspaces: tuple[bool, bool] = (False, False)
    rays: tuple[bool, bool] = (True, True)

    def declare(self, block: Any, axes: range) -> None:
        """Normals and offsets of both ends and their rows, still empty."""
        ends = (block.separations, list(_ENDS))
        add_components(
            block,
            end_normal=Var(*ends, list(axes), bounds=WIDER_THAN_ONE, dense=False, doc="normals at start and end"),
            end_offset=Var(*ends, dense=False, doc="offsets at start and end"),
            normal=empty_expressions("mean of the normals at start and end"),
            normal_at=empty_expressions("normals at the times of the poses"),
            turned_normal=empty_expressions("normals in the frame of a body"),
            level=empty_expressions("height of a body's origin over the plane"),
            first_shape=empty_rows("vertices of the first shape: beyond the plane by what is required"),
            second_shape=empty_rows("vertices of the second shape: behind the plane"),
            unit=empty_rows("lengths of the normals at start and end"),
        )

    def add(self, block: Any, index: SeparationIndex, first: PosedShape, second: PosedShape) -> None:
        """Variables and rows of one plane."""
        dimension = first.shape.dimension
        normals = [[block.end_normal.add((*index, end, axis)) for axis in range(dimension)] for end in _ENDS]
        offsets = [block.end_offset.add((*index, end)) for end in _ENDS]
        for axis in range(dimension):
            block.normal.add((*index, axis), 0.5 * (normals[0][axis] + normals[1][axis]))
        required = block.required[index]
        for name, rows, posed, upward in (
            ("first", block.first_shape, first, True),
            ("second", block.second_shape, second, False),
        ):
            for place, pose, s, rise in _places(index, posed):
                normal = [
                    block.normal_at.add((name, *place, axis), _between(normals[0][axis], normals[1][axis], s))
                    for axis in range(dimension)
                ]
                offset = _between(offsets[0], offsets[1], s)
                level = dot(normal, pose.translation) - (offset + required + rise if upward else offset - rise)
                level = block.level.add((name, *place), level)
                direction = [
                    block.turned_normal.add((name, *place, axis), entry)
                    for axis, entry in enumerate(turned(normal, pose))
                ]
                shape = posed.shape
                state_side(rows, place, shape.vertices, shape.rays, direction, level, upward=upward)
        for end in _ENDS:
            block.unit.add((*index, end), norm_relation(normals[end], "ball"))

    def start(
        self, block: Any, index: SeparationIndex, first: PlacedShape, second: PlacedShape, normal: np.ndarray
    ) -> None:
        """The normals of both ends where the shapes are apart there and the plane turns little; else the given one."""
        ends = [[_at_end(placed, end) for placed in (first, second)] for end in _ENDS]
        normals = [normal, normal]
        if not len(first.rays) and not len(second.rays):
            nearest = [distance_of_points(p, q) for p, q in ends]
            own = [near.normal for near in nearest]
            turns_little = own[0] @ own[1] > 0.0 and min(entry @ normal for entry in own) > 0.0
            if turns_little and min(near.distance for near in nearest) > 0.0:
                normals = own
        for end, (vector, (p, q)) in enumerate(zip(normals, ends, strict=True)):
            for axis, number in enumerate(vector.tolist()):
                block.end_normal[(*index, end, axis)].set_value(number, skip_validation=True)
            upper, lower = float((p @ vector).min()) - value(block.required[index]), float((q @ vector).max())
            block.end_offset[(*index, end)].set_value((upper + lower) / 2, skip_validation=True)

    def set_norm(self, block: Any, index: SeparationIndex, norm: str) -> None:
        """Bound the lengths of the normals, or fix them."""
        for end in _ENDS:
            normal = [block.end_normal[(*index, end, axis)] for axis in block.axes]
            block.unit[(*index, end)].set_value(norm_relation(normal, norm))

    def ends(self, block: Any, index: SeparationIndex) -> tuple[np.ndarray, np.ndarray]:
        """Normals (2, d) and offsets (2,) at the start and the end; NaN where they have no value."""
        normals = [[block.end_normal[(*index, end, axis)].value for axis in block.axes] for end in _ENDS]
        offsets = [block.end_offset[(*index, end)].value for end in _ENDS]
        return np.array(normals, dtype=float), np.array(offsets, dtype=float)


def _places(index: SeparationIndex, posed: PosedShape) -> list[tuple[tuple[Any, ...], Any, float, Any]]:
    """Index, pose, local time and rise of each pose; a shape that rests has its pose at both ends."""
    if len(posed.poses) == 1:
        ((time, pose),) = posed.poses
        return [((*index, time, s), pose, s, 0.0) for s in (0.0, 1.0)]
    rises = posed.rises or (0.0,) * len(posed.poses)
    return [
        ((*index, time), pose, s, rise)
        for (time, pose), s, rise in zip(posed.poses, posed.local_times, rises, strict=True)
    ]


def _between(start: Any, end: Any, s: float) -> Any:
    return start if s == 0.0 else end if s == 1.0 else (1.0 - s) * start + s * end


def _at_end(placed: PlacedShape, end: int) -> np.ndarray:
    """The corners of a shape at the start or the end of a segment."""
    count = len(placed.shape.vertices)
    return placed.vertices[-count:] if end else placed.vertices[:count]
