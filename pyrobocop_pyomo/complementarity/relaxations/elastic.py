"""One bound for all products, and a penalty of the bound."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pyrobocop_pyomo.errors import ComplementarityError


@dataclass(frozen=True)
class Elastic:
    """Bound all products by one variable with a penalty: ``a * b <= t`` and ``J + t / delta``.

    Here ``0 <= t <= excess_bound``: the penalty is the l-infinity norm of the products and not their sum. Near a
    strongly stationary solution it is exact: t vanishes at some positive delta already.

    Attributes
    ----------
    excess_bound : float
        Largest value of t; positive.

    References
    ----------
    Anitescu, Tseng & Wright (2007), Elastic-mode algorithms for mathematical programs with equilibrium constraints:
    global convergence and stationarity properties, Math. Program. 110, doi:10.1007/s10107-006-0005-4
    """

    excess_bound: float = 10.0

    def __post_init__(self) -> None:
        """Refuse a bound that leaves t no room."""
        if not self.excess_bound > 0:
            raise ComplementarityError(f"{self}: excess_bound must be positive.")

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return ``a * b - t``; the model passes t for delta."""
        return a * b - delta

    def shift(self, delta: Any) -> Any:
        """Return t, the bound of a product or of a sum of them."""
        return delta

    def coefficient(self, delta: Any) -> Any:
        """Return ``1 / delta``, the penalty coefficient of t."""
        return 1 / delta
