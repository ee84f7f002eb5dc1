"""Both shapes by their half-spaces, with all facets moved outwards by the same distance until the shapes touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import value

from .facets import add_both_shapes, declare_both_shapes, start_both_shapes
from .protocol import PlacedShape, PosedShape, SeparationIndex
from .rows import empty_rows


@dataclass(frozen=True)
class Offset:
    """Dual of the linear program that moves all facets outwards until the shapes touch.

    As `Dual`, with a linear measure in place of the Euclidean one::

        n = R2 A'l     R1 G'm + n = 0     n.(t1 - t2) - b'l - g'm >= required     sum l + sum m = 2

    The gap is signed and never more than the distance, since ``|n| <= min(sum l, sum m) <= 1``. Where corners are
    nearest it is less, so that plans keep farther away than asked.
    """

    name: str = "offset"
    covers_intervals: bool = False
    signed: bool = True
    norms: tuple[str, ...] = ()
    halfspaces: tuple[bool, bool] = (True, True)
    rays: tuple[bool, bool] = (True, True)

    def declare(self, block: Any, axes: range) -> None:
        """Weights, normal and rows, still empty."""
        declare_both_shapes(block, measure=empty_rows("sum of all weights"))

    def add(self, block: Any, index: SeparationIndex, first: PosedShape, second: PosedShape) -> None:
        """Weights and rows of one separation."""
        weights, _ = add_both_shapes(block, index, first, second)
        block.measure.add(index, sum(weights) == 2)

    def start(
        self, block: Any, index: SeparationIndex, first: PlacedShape, second: PlacedShape, normal: np.ndarray
    ) -> None:
        """Weights that give the normal, shortened until they have the right sum."""
        start_both_shapes(block, index, first, second, normal)
        weights = [block.first_weight[(*index, facet)] for facet in range(len(first.shape.halfspaces[1]))] + [
            block.second_weight[(*index, facet)] for facet in range(len(second.shape.halfspaces[1]))
        ]
        scale = 2.0 / sum(value(weight) for weight in weights)
        for weight in weights:
            weight.set_value(scale * value(weight), skip_validation=True)

    def set_norm(self, block: Any, index: SeparationIndex, norm: str) -> None:
        """Do nothing: the sum of the weights fixes the length."""
