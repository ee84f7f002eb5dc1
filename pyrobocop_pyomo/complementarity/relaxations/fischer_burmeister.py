"""The set of a bounded product, written by a function that grows linearly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class FischerBurmeister:
    """Bound ``a + b - sqrt(a^2 + b^2 + 2 delta)`` by zero.

    For ``a + b >= 0`` this says ``a * b <= delta``, as `Scholtes` does; the residual grows linearly in the sides and
    not with their product. The rates are those of `Scholtes`.

    References
    ----------
    Fischer (1992), A special Newton-type optimization method, Optimization 24:269-284;
    with delta: Kanzow (1996), Some noninterior continuation methods for linear complementarity problems,
    SIAM J. Matrix Anal. Appl. 17:851-868
    """

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return ``a + b - sqrt(a^2 + b^2 + 2 delta)``."""
        return a + b - (a**2 + b**2 + 2 * delta) ** 0.5  # a power, since math.sqrt refuses expressions

    def shift(self, delta: Any) -> None:
        """Return None: delta stands under the root."""
        return
