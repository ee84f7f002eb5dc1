"""The corner of a pair rounded off, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pyrobocop_pyomo.modeling.expressions import choose


@dataclass(frozen=True)
class SteffensenUlbrich:
    """Round off the corner: ``a + b <= phi(a - b)`` with ``phi(z) = |z|`` where ``|z| >= delta``.

    Between, ``phi(z) = (-z^4 / delta^3 + 6 z^2 / delta + 3 delta) / 8``: the polynomial kink of the paper, which meets
    ``|z|`` with two continuous derivatives. (Its other kink is a sine, with the same properties.)
    Where the sides differ by delta or more, the pair is met exactly; so the relaxed solution is exact as soon as
    delta is below the larger side of each pair, and off by O(delta) at a biactive solution.

    References
    ----------
    Steffensen & Ulbrich (2010), A new relaxation scheme for mathematical programs with equilibrium constraints,
    SIAM J. Optim. 20, doi:10.1137/090748883
    """

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return ``a + b - phi(a - b)``."""
        z = a - b
        kink = (6 * z**2 / delta - z**4 / delta**3 + 3 * delta) / 8
        return a + b - choose(delta - abs(z), kink, abs(z))

    def shift(self, delta: Any) -> None:
        """Return None: delta says how wide the kink is."""
        return
