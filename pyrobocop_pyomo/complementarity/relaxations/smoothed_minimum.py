"""The minimum of both sides, smoothed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ChenHarkerKanzowSmale:
    """Bound the smoothed natural residual ``a + b - sqrt((a - b)^2 + 4 delta)`` by zero.

    It is twice ``min(a, b)`` at ``delta = 0``. For ``a + b >= 0`` it says ``a * b <= delta``, as
    `Scholtes` does, but is nearly affine away from the corner. The rates are those of `Scholtes`.

    References
    ----------
    Chen & Harker (1993), A non-interior-point continuation method for linear complementarity problems,
    SIAM J. Matrix Anal. Appl. 14; Kanzow (1996), Some noninterior continuation methods for linear complementarity
    problems, SIAM J. Matrix Anal. Appl. 17:851-868
    """

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return ``a + b - sqrt((a - b)^2 + 4 delta)``."""
        return a + b - ((a - b) ** 2 + 4 * delta) ** 0.5

    def shift(self, delta: Any) -> None:
        """Return None: delta stands under the root."""
        return
