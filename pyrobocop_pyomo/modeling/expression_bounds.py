"""Bounds of expressions by Pyomo's interval arithmetic, whatever functions they hold."""

from __future__ import annotations

import math
from typing import Any

from pyomo.common.errors import InfeasibleConstraintException
from pyomo.contrib.fbbt.expression_bounds_walker import ExpressionBoundsVisitor


class ExpressionBounds(ExpressionBoundsVisitor):
    """As its base; unbounded where it has no bounds of a function, no value within its bounds, or an overflow."""

    def exitNode(self, node: Any, data: Any) -> tuple[float, float]:
        """Bounds of a node, from those of its arguments."""
        try:
            bounds: tuple[float, float] = super().exitNode(node, data)
        except (KeyError, InfeasibleConstraintException, ArithmeticError, ValueError):
            return -math.inf, math.inf
        unknown = any(isinstance(end, float) and math.isnan(end) for end in bounds)  # others are truth values
        return (-math.inf, math.inf) if unknown else bounds
