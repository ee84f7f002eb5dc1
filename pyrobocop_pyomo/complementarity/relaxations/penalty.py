"""A penalty of the products instead of a bound."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Penalty:
    """Penalise the products: add ``(1 / delta) * sum_l w_l * a_l * b_l`` to a minimised objective.

    The sides stay constraints, and nothing bounds a product. Near a solution that is strongly stationary the
    penalty is exact: the products vanish at some positive delta already, which need not go to zero. The
    weights w_l measure the pairs, so that a finer mesh does not count as more violation. Since the sides are not
    negative, the sum is the l1 norm of the products.

    References
    ----------
    Ralph & Wright (2004), Some properties of regularization and penalization schemes for MPECs,
    doi:10.1080/10556780410001709439
    """

    def coefficient(self, delta: Any) -> Any:
        """Return ``1 / delta``."""
        return 1 / delta
