"""Both shapes by their half-spaces: the dual of the distance between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .facets import add_both_shapes, declare_both_shapes, start_both_shapes
from .protocol import PlacedShape, PosedShape, SeparationIndex
from .rows import empty_rows, norm_relation, set_norm


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
        declare_both_shapes(block, unit=empty_rows("length of the normal"))

    def add(self, block: Any, index: SeparationIndex, first: PosedShape, second: PosedShape) -> None:
        """Weights and rows of one separation."""
        _, normal = add_both_shapes(block, index, first, second)
        block.unit.add(index, norm_relation(normal, "ball"))

    def start(
        self, block: Any, index: SeparationIndex, first: PlacedShape, second: PlacedShape, normal: np.ndarray
    ) -> None:
        """Weights that give the normal."""
        start_both_shapes(block, index, first, second, normal)

    def set_norm(self, block: Any, index: SeparationIndex, norm: str) -> None:
        """Bound the length of the normal, or fix it."""
        set_norm(block, index, norm)
