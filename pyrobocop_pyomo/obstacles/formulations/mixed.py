"""The first shape by its corners, the second by its half-spaces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .facets import add_normal, add_weights, start_weights, weights_component
from .protocol import PlacedShape, PosedShape, SeparationIndex
from .rows import add_components, dot, empty_expressions, empty_rows, norm_relation, set_norm, turned


@dataclass(frozen=True)
class Mixed:
    """A normal made of the second shape's facets, and all corners of the first beyond it.

    With weights ``l >= 0`` of the facets of ``{y : A y <= b}`` at ``(R2, t2)`` and the corners ``V_i`` of the first
    shape at ``(R1, t1)``::

        n = R2 A'l        n.(R1 V_i + t1 - t2) - b'l >= required        n.n <= 1 or n.n = 1

    One pose at a time. Suits unbounded obstacles, and those of many corners and few facets.
    """

    name: str = "mixed"
    covers_intervals: bool = False
    signed: bool = True
    norms: tuple[str, ...] = ("ball", "sphere")
    halfspaces: tuple[bool, bool] = (False, True)
    rays: tuple[bool, bool] = (True, True)

    def declare(self, block: Any, axes: range) -> None:
        """Weights, normal and rows, still empty."""
        add_components(
            block,
            second_weight=weights_component(block, "weights of the facets of the second shape"),
            normal=empty_expressions("normal of each separation"),
            turned_normal=empty_expressions("normals in the frame of the first shape"),
            level=empty_expressions("height of the first shape's origin"),
            first_shape=empty_rows("corners of the first shape: beyond the second by what is required"),
            unit=empty_rows("length of the normal"),
        )

    def add(self, block: Any, index: SeparationIndex, first: PosedShape, second: PosedShape) -> None:
        """Weights and rows of one separation."""
        weights = add_weights(block.second_weight, index, second)
        normal, offset = add_normal(block, index, weights, second)
        (_, here), (_, there) = first.poses[0], second.poses[0]
        height = dot(here.translation, normal) - dot(there.translation, normal) - offset - block.required[index]
        level = block.level.add(index, height)
        direction = [block.turned_normal.add((*index, axis), entry) for axis, entry in enumerate(turned(normal, here))]
        rows = [dot(corner, direction) + level for corner in first.shape.vertices.tolist()]
        rows += [dot(ray, direction) for ray in first.shape.rays.tolist()]
        for number, row in enumerate(rows):
            block.first_shape.add((*index, number), (0.0, row, None))
        block.unit.add(index, norm_relation(normal, "ball"))

    def start(
        self, block: Any, index: SeparationIndex, first: PlacedShape, second: PlacedShape, normal: np.ndarray
    ) -> None:
        """Weights that give the normal."""
        start_weights(block.second_weight, index, second, normal)

    def set_norm(self, block: Any, index: SeparationIndex, norm: str) -> None:
        """Bound the length of the normal, or fix it."""
        set_norm(block, index, norm)
