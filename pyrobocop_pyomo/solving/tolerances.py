"""When a point counts as acceptable."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Tolerances:
    """When a point counts as acceptable.

    Attributes
    ----------
    feasibility : float
        Largest violation of a constraint, a bound or a side.
    product : float
        Largest product ``a b`` of a pair.
    natural : float
        Largest ``|min(a, b)|`` of a point that needs no further strategy.
    stationarity : float
        Largest relative gradient of the Lagrangian.
    """

    feasibility: float = 1e-6
    product: float = 1e-7
    natural: float = 1e-6
    stationarity: float = 1e-5
