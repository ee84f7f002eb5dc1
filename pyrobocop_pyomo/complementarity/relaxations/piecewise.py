"""One choice between two formulas for floats, arrays and Pyomo expressions."""

from __future__ import annotations

from typing import Any

import numpy as np
from pyomo.core.expr import Expr_if


def choose(number: Any, where_nonnegative: Any, elsewhere: Any) -> Any:
    """Return the first formula where the number is at least zero, and the second one elsewhere.

    Both are evaluated for arrays, and only the one that is chosen in a solver.
    """
    if hasattr(number, "is_potentially_variable"):
        return Expr_if(IF_=number >= 0, THEN_=where_nonnegative, ELSE_=elsewhere)
    chosen = np.where(np.asarray(number) >= 0, where_nonnegative, elsewhere)
    return chosen if chosen.ndim else chosen.item()
