"""How well the pairs are met, computed from the values on the model and not from the generated rows."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.modeling.row_violations import number_or_nan

from .canonical import CanonicalPair, SidePart


@dataclass(frozen=True)
class PairResidual:
    """The values of one pair ``0 <= a ⟂ b >= 0``.

    Attributes
    ----------
    name : str
        Of the pair as declared; of a range with "(lower)" or "(upper)" behind it, one residual for either bound.
    a, b : float
        Values of the two sides. Of a range ``l <= F <= u ⟂ H``: the distance from the bound, and what H is beyond
        zero to the side that this bound answers, ``max(H, 0)`` for the lower and ``max(-H, 0)`` for the upper.
    """

    name: str
    a: float
    b: float

    @property
    def product(self) -> float:
        """``a * b``: what a relaxation bounds."""
        return self.a * self.b

    @property
    def natural(self) -> float:
        """``min(a, b)``: zero exactly where the pair is met, and the distance to that near it."""
        return min(self.a, self.b)

    @property
    def infeasibility(self) -> float:
        """By how much the worse of ``a >= 0`` and ``b >= 0`` is violated, 0 if neither is."""
        return max(0.0, -self.a, -self.b)


@dataclass(frozen=True)
class ComponentResidual:
    """How well all pairs of one component are met.

    Attributes
    ----------
    name : str
        Of the component, as declared.
    pairs : int
        How many pairs it has; a range counts twice.
    largest, total : float
        Maximum and sum of ``|min(a, b)|``.
    """

    name: str
    pairs: int
    largest: float
    total: float


def component_residuals(pairs: Iterable[CanonicalPair]) -> list[ComponentResidual]:
    """Sum pairs up by the component that they were declared in; errors as `pair_residuals`."""
    found: dict[str, list[float]] = {}
    for pair in pairs:
        found.setdefault(pair.source.parent_component().name, []).append(abs(min(side_values(pair))))
    return [ComponentResidual(name, len(sizes), max(sizes), sum(sizes)) for name, sizes in found.items()]


def pair_residuals(pairs: Iterable[CanonicalPair]) -> list[PairResidual]:
    """Evaluate pairs at the current values.

    Raises
    ------
    ComplementarityError
        If a variable of a side has no value.
    """
    return [PairResidual(pair.name, *side_values(pair)) for pair in pairs]


def side_values(pair: CanonicalPair, unknown: float | None = None) -> tuple[float, float]:
    """Return the values of both sides, of a part of a range the value of that part.

    Parameters
    ----------
    pair : CanonicalPair
    unknown : float, optional
        Returned for a side without a value; by default that is an error, as for `pair_residuals`.
    """
    a, b = (_number(pair, side, unknown) for side in (pair.a, pair.b))
    return _part(a, pair.a_part), _part(b, pair.b_part)


def _part(number: float, part: SidePart) -> float:
    if part is SidePart.WHOLE or math.isnan(number):
        return number
    return max(number if part is SidePart.POSITIVE else -number, 0.0)


def _number(pair: CanonicalPair, side: Any, unknown: float | None) -> float:
    if unknown is not None:
        number = number_or_nan(side)
        return unknown if math.isnan(number) else number
    number = value(side, exception=False)
    if number is None:
        raise ComplementarityError(
            f"'{pair.name}': the side '{side}' holds a variable without a value. Solve the model, or set the value."
        )
    return float(number)
