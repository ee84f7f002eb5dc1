"""How well the pairs are met, computed from the values on the model and not from the generated rows."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.modeling.row_violations import number_or_nan

from .forms import CanonicalForm, CanonicalPair, SidePart


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
    return float(part_of_side(a, pair.a_part)), float(part_of_side(b, pair.b_part))


def sides_at_zero(form: CanonicalForm) -> list[tuple[CanonicalPair, Any, str]]:
    """The sides that are held at zero, of each pair the one that is smaller now: the pair, its side, and which it is.

    The parts of a free side are zero together: one equation, and only where no bound of the range has one.
    """
    stated = [(pair, *side_values(pair)) for pair in form.pairs if pair.a_part is SidePart.WHOLE]
    first = [(pair, pair.a, "first") for pair, a, b in stated if a < b]
    second = [(pair, pair.b, "second") for pair, a, b in stated if not a < b]
    whole = [each for each in second if each[0].b_part is SidePart.WHOLE]
    parts = [each for each in second if each[0].b_part is not SidePart.WHOLE]
    return [*first, *whole, *([] if first else parts[:1])]


def part_of_side(values: Any, part: SidePart) -> Any:
    """What numbers of a side, or arrays of them, count for as a part of a range."""
    return values if part is SidePart.WHOLE else np.maximum(values if part is SidePart.POSITIVE else -values, 0.0)


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
