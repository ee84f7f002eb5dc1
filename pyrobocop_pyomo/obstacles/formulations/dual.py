"""Both shapes by their half-spaces: the dual of the distance between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .facets import add_normal, add_weights, between_origins, combination, start_weights, turned_out, weights_component
from .protocol import Index, PlacedSide, Side
from .rows import add_components, empty_expressions, empty_rows, norm_relation


@dataclass(frozen=True)
class Dual:
    """Dual of the distance of ``{z : G z <= g}`` at ``(R1, t1)`` and ``{y : A y <= b}`` at ``(R2, t2)``.

    With weights ``m, l >= 0`` of the facets::

        n = R2 A'l        R1 G'm + n = 0        n.(t1 - t2) - b'l - g'm >= required        n.n <= 1 or n.n = 1

    One pose at a time. The length of the normal bounded: the distance; fixed: the signed distance.

    References
    ----------
    Zhang, Liniger & Borrelli, Optimization-Based Collision Avoidance, arXiv:1711.03449
    """

    name: str = "dual"
    covers_intervals: bool = False
    signed: bool = True
    norms: tuple[str, ...] = ("ball", "sphere")
    halfspaces: tuple[bool, bool] = (True, True)
    rays: tuple[bool, bool] = (True, True)

    def declare(self, block: Any, axes: range) -> None:
        """Weights, normal and rows, still empty."""
        add_components(
            block,
            first_weight=weights_component(block, "weights of the facets of the first shape"),
            second_weight=weights_component(block, "weights of the facets of the second shape"),
            normal=empty_expressions("normal of each certificate"),
            balance=empty_rows("both shapes have the same normal, with opposite signs"),
            separation=empty_rows("the separation that is proven"),
            unit=empty_rows("length of the normal"),
        )

    def add(self, block: Any, index: Index, first: Side, second: Side) -> None:
        """Weights and rows of one certificate."""
        first_weights = add_weights(block.first_weight, index, first)
        second_weights = add_weights(block.second_weight, index, second)
        normal, second_offset = add_normal(block, index, second_weights, second)
        direction, first_offset = combination(first_weights, first)
        for axis, (entry, opposite) in enumerate(zip(turned_out(direction, first), normal, strict=True)):
            block.balance.add((*index, axis), entry + opposite == 0)
        proven = between_origins(normal, first, second) - second_offset - first_offset
        block.separation.add(index, (0.0, proven - block.required[index], None))
        block.unit.add(index, norm_relation(normal, "ball"))

    def start(self, block: Any, index: Index, first: PlacedSide, second: PlacedSide, normal: np.ndarray) -> None:
        """Weights that give the normal."""
        start_weights(block.second_weight, index, second, normal)
        start_weights(block.first_weight, index, first, -normal)

    def set_norm(self, block: Any, index: Index, norm: str) -> None:
        """Bound the length of the normal, or fix it."""
        block.unit[index].set_value(norm_relation([block.normal[(*index, axis)] for axis in block.axes], norm))
