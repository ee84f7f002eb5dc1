"""An L-shaped strip with a smooth description."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pyrobocop_pyomo.modeling.expressions import choose


@dataclass(frozen=True)
class KanzowSchwartz:
    """Bound the smaller side: ``phi(a - delta, b - delta) <= 0`` with a smooth phi, which says ``min(a, b) <= delta``.

    ``phi(p, q) = p * q`` where ``p + q >= 0`` and ``-(p^2 + q^2) / 2`` elsewhere, once continuously differentiable.
    Relaxed solutions are off by O(delta).

    References
    ----------
    Kanzow & Schwartz (2013), A new regularization method for mathematical programs with complementarity constraints
    with strong convergence properties, SIAM J. Optim. 23, doi:10.1137/100802487
    """

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return ``phi(a - delta, b - delta)``."""
        p, q = a - delta, b - delta
        return choose(p + q, p * q, -(p**2 + q**2) / 2)

    def shift(self, delta: Any) -> None:
        """Return None: delta stands in the product."""
        return
