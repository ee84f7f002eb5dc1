"""Two hyperbolas instead of a hyperbola and two signs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class LinFukushima:
    """Bound the product from both sides: ``a * b <= delta^2`` and ``(a + delta) * (b + delta) >= delta^2``.

    No row keeps the signs: the second hyperbola does, up to ``a, b > -delta``. The bound that the user put on a
    variable stays. Relaxed solutions are off by O(delta) at a biactive solution; at one where a side is positive, by
    O(delta^2) where the product holds the other side, by O(delta) where its sign does.

    References
    ----------
    Lin & Fukushima (2005), A modified relaxation scheme for mathematical programs with complementarity
    constraints, Ann. Oper. Res. 133, doi:10.1007/s10479-004-5024-z
    """

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return ``a * b - delta^2``."""
        return a * b - delta**2

    def further_residuals(self, a: Any, b: Any, delta: Any) -> tuple[Any, ...]:
        """Return ``delta^2 - (a + delta) * (b + delta)``."""
        return (delta**2 - (a + delta) * (b + delta),)

    def side_slack(self, delta: Any) -> None:
        """Return None: no row keeps a sign."""
        return

    def shift(self, delta: Any) -> None:
        """Return None: delta stands in products."""
        return
