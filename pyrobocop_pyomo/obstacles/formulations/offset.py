"""Both shapes by their half-spaces, with the facets of both pushed out by the same distance until they touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import value

from .facets import add_both_sides, declare_both_sides, start_both_sides
from .protocol import Index, PlacedSide, Side
from .rows import empty_rows


@dataclass(frozen=True)
class Offset:
    """Dual of the linear program that pushes all facets out until the shapes touch.

    As `Dual`, with a linear measure in place of the Euclidean one::

        n = R2 A'l     R1 G'm + n = 0     n.(t1 - t2) - b'l - g'm >= required     sum l + sum m = 2

    The separation is signed and never more than the distance, since ``|n| <= min(sum l, sum m) <= 1``; where corners
    are nearest it is less, so that plans keep farther away than asked.
    """

    name: str = "offset"
    covers_intervals: bool = False
    signed: bool = True
    norms: tuple[str, ...] = ()
    halfspaces: tuple[bool, bool] = (True, True)
    rays: tuple[bool, bool] = (True, True)

    def declare(self, block: Any, axes: range) -> None:
        """Weights, normal and rows, still empty."""
        declare_both_sides(block, measure=empty_rows("sum of all weights"))

    def add(self, block: Any, index: Index, first: Side, second: Side) -> None:
        """Weights and rows of one certificate."""
        weights, _ = add_both_sides(block, index, first, second)
        block.measure.add(index, sum(weights) == 2)

    def start(self, block: Any, index: Index, first: PlacedSide, second: PlacedSide, normal: np.ndarray) -> None:
        """Weights that give the normal, shortened until they have the right sum."""
        start_both_sides(block, index, first, second, normal)
        weights = [block.first_weight[(*index, facet)] for facet in range(len(first.shape.halfspaces[1]))] + [
            block.second_weight[(*index, facet)] for facet in range(len(second.shape.halfspaces[1]))
        ]
        scale = 2.0 / sum(value(weight) for weight in weights)
        for weight in weights:
            weight.set_value(scale * value(weight), skip_validation=True)

    def set_norm(self, block: Any, index: Index, norm: str) -> None:
        """Nothing: the sum of the weights is the measure."""
