"""Template of a relaxation: what bounds a product of two nonnegative sides."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)  # frozen and comparable: a model remembers what it was relaxed with
class FischerBurmeister:
    """``a + b <= sqrt(a^2 + b^2 + 2 delta)``: the set ``a * b <= delta``, growing linearly in a and b.

    References
    ----------
    Fischer (1992), A special Newton-type optimization method, doi:10.1080/02331939208843795
    """

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return what must not be positive; the same line serves floats, arrays and Pyomo expressions."""
        return a + b - (a**2 + b**2 + 2 * delta) ** 0.5  # a power, since math.sqrt refuses expressions

    def shift(self, delta: Any) -> Any:
        """Return None: delta stands under the root and cannot be split off.

        So it cannot follow the barrier parameter inside a solve and needs a schedule of several solves; in a group,
        each product gets a share of delta.
        """
        return None
