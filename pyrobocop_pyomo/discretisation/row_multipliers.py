"""Multipliers of a model's rows and bounds, whoever found them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, eq=False)
class RowMultipliers:
    """What the objective would change by, per unit, in the signs of Pyomo's suffixes; by the identity of components.

    Attributes
    ----------
    rows : mapping of int to float
        As in ``dual``: change of the objective as stated per unit of the right-hand side.
    lower, upper : mapping of int to float
        As in ``ipopt_zL_out`` and ``ipopt_zU_out``.
    """

    rows: Mapping[int, float]
    lower: Mapping[int, float]
    upper: Mapping[int, float]

    def of_row(self, row: Any) -> float:
        """That of a constraint; 0 where it has none, as a row without free variables."""
        return self.rows.get(id(row), 0.0)
