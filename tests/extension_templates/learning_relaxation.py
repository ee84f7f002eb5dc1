"""Template of a relaxation with numbers that it keeps between solves: here, a bound for each product."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)  # the numbers live on the model, not here: one object serves many models
class Reluctant:
    """``a * b <= d`` with a d of its own per product, which shrinks only where the product does not vanish by itself.

    Attributes
    ----------
    share : float
        Of the next delta: products below do not ask for a smaller bound.
    """

    share: float = 0.1

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return what must not be positive; the model passes the row's own d for delta."""
        return a * b - delta

    def shift(self, delta: Any) -> Any:
        """Return d: residuals of this kind may be added up over a group."""
        return delta

    def next_bound(self, bound: float, delta: float, products: list[tuple[float, float]], multiplier: float) -> float:
        """Return d for the next solve.

        Parameters
        ----------
        bound : float
            d of the last solve; delta at first.
        delta : float
            Of the next solve.
        products : list of (float, float)
            Values of the two factors, of each product of the row.
        multiplier : float
            Of the row, not negative: what the objective would gain if d grew.
        """
        vanish = all(a * b <= self.share * delta for a, b in products)
        return bound if vanish and multiplier * bound <= delta else min(bound, delta)

    def next_slack(self, slack: float, delta: float, side: float, partner: float, multiplier: float) -> float:
        """Return how far a side may be negative in the next solve; without `side_slack`, no row asks for it."""
        return 0.0
