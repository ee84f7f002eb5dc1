"""Relaxing the sign or the product of a pair, but in the end not both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pyrobocop_pyomo.errors import ComplementarityError


@dataclass(frozen=True)
class TwoSided:
    """Relax signs and product, ``a, b >= -s`` and ``a * b <= d``, each with a number of its own.

    All numbers start at delta. After a solve, a multiplier ``lambda * b`` of the product above `threshold`
    says that the product holds the side a and not its sign: then d goes on to the next delta, and the slack of a
    stays. Otherwise the slack goes on, and d stays. Whatever stays keeps the relaxed set from degenerating to a
    corner; it stays only while the pair is met up to the next delta all the same. So the numbers follow the sign
    of the multiplier ``z - lambda * b`` that the side has in the problem with complementarity. With the right ones
    kept, relaxed solutions are off by O(delta) where numbers still decide, and exact where they do not.

    The bound that the user put on a variable stays as it is; then only the product is relaxed.

    Attributes
    ----------
    threshold : float
        Of the multiplier; positive.

    References
    ----------
    DeMiguel, Friedlander, Nogales & Scholtes (2005), A two-sided relaxation scheme for mathematical programs with
    equilibrium constraints, SIAM J. Optim. 16, doi:10.1137/04060754X
    """

    threshold: float = 1e-6

    def __post_init__(self) -> None:
        """Refuse a threshold that decides nothing."""
        if not self.threshold > 0:
            raise ComplementarityError(f"{self}: threshold must be positive.")

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return ``a * b - d``; the model passes the row's own d for delta."""
        return a * b - delta

    def shift(self, delta: Any) -> Any:
        """Return d, the bound of a product or of a sum of them."""
        return delta

    def side_slack(self, delta: Any) -> Any:
        """Return the first slack of a side."""
        return delta

    def next_bound(self, bound: float, delta: float, products: list[tuple[float, float]], multiplier: float) -> float:
        """Return the bound of a row for the next solve, whose delta is given."""
        pressing = any(abs(multiplier) * max(a, b) > self.threshold for a, b in products)
        met = all(min(a, b) <= delta and a * b <= delta for a, b in products)
        return bound if met and not pressing else min(bound, delta)

    def next_slack(self, slack: float, delta: float, side: float, partner: float, multiplier: float) -> float:
        """Return the slack of a side for the next solve, whose delta is given."""
        held_by_product = abs(multiplier) * partner > self.threshold
        return slack if held_by_product and side >= -delta else min(slack, delta)
