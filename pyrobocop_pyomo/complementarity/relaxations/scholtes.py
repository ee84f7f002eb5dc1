"""Bounding the product of a pair."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Scholtes:
    """Bound the product: ``a * b <= delta``.

    At a solution where one side of each pair is positive, the relaxed solution is off by O(delta); at a biactive
    one, where both vanish, by O(sqrt(delta)).

    References
    ----------
    Scholtes (2001), Convergence properties of a regularization scheme for mathematical programs with
    complementarity constraints, SIAM J. Optim. 11, doi:10.1137/S1052623499361233
    """

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return ``a * b - delta``."""
        return a * b - delta

    def shift(self, delta: Any) -> Any:
        """Return delta: the row ``a * b <= delta`` moves by delta itself."""
        return delta
