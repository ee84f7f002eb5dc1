"""How well the pairs are met, computed from the values on the model and not from the generated rows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ComplementarityError

from .pairs import CanonicalPair


@dataclass(frozen=True)
class PairResidual:
    """The values of one pair ``0 <= a ⟂ b >= 0``.

    Attributes
    ----------
    name : str
        Of the pair as declared.
    a, b : float
        Values of the two sides.
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


def pair_residuals(pairs: Iterable[CanonicalPair]) -> list[PairResidual]:
    """Evaluate pairs at the current values.

    Raises
    ------
    ComplementarityError
        If a variable of a side has no value.
    """
    return [PairResidual(pair.name, _number(pair, pair.a), _number(pair, pair.b)) for pair in pairs]


def _number(pair: CanonicalPair, side: Any) -> float:
    number = value(side, exception=False)
    if number is None:
        raise ComplementarityError(
            f"'{pair.name}': the side '{side}' holds a variable without a value. Solve the model, or set the value."
        )
    return float(number)
