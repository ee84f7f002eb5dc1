"""Penalties of the products and their squares, with multipliers that are updated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class AugmentedLagrangian:
    """Penalise products and squares: add ``sum_l w_l * (lambda_l * p_l + rho / 2 * p_l^2)``, ``p_l = a_l * b_l``.

    Here ``rho = 1 / delta``. After each solve ``lambda_l`` grows by ``rho * p_l``, so that the products vanish in the
    limit although delta stays away from zero. The model keeps ``u_l = lambda_l / rho``, with which the term is
    ``rho * sum_l w_l * (u_l * p_l + p_l^2 / 2)``. With multipliers at zero a product of O(delta) is left, where
    the objective pulls at it.

    References
    ----------
    Izmailov, Solodov & Uskov (2012), Global convergence of augmented Lagrangian methods applied to optimization
    problems with degenerate constraints, including problems with complementarity constraints,
    SIAM J. Optim. 22:1579-1606
    """

    def coefficient(self, delta: Any) -> Any:
        """Return ``rho = 1 / delta``."""
        return 1 / delta

    def penalty(self, product: Any, multiplier: Any) -> Any:
        """Return ``u * p + p^2 / 2``."""
        return multiplier * product + product**2 / 2

    def next_multiplier(self, multiplier: float, product: float, delta: float, next_delta: float) -> float:
        """Return ``(lambda + rho * p) / rho_next``."""
        return (multiplier + product) * next_delta / delta
