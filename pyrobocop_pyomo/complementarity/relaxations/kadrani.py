"""Two strips that touch in a point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Kadrani:
    """Bound the shifted product: ``a, b >= -delta`` and ``(a - delta) * (b - delta) <= 0``.

    Relaxed solutions are off by O(delta). The set is two strips that touch in the point (delta, delta) alone, so a
    solver hardly gets from one to the other; and it leaves out the points of the pair within delta of the origin,
    so it is no relaxation in the strict sense, and the sets of two delta are not nested. The bound that the user
    put on a variable stays as it is.

    References
    ----------
    Kadrani, Dussault & Benchakroun (2009), A new regularization scheme for mathematical programs with
    complementarity constraints, SIAM J. Optim. 20, doi:10.1137/070705490
    """

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return ``(a - delta) * (b - delta)``."""
        return (a - delta) * (b - delta)

    def side_slack(self, delta: Any) -> Any:
        """Return delta: a side may be negative by as much."""
        return delta

    def shift(self, delta: Any) -> None:
        """Return None: delta stands in the product."""
        return
