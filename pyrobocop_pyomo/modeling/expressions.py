"""Expressions: what they hold, whether two are alike, their values, and a choice between two.

Bounds of expressions by Pyomo's interval arithmetic, whatever functions they hold.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from pyomo.common.errors import InfeasibleConstraintException
from pyomo.contrib.fbbt.expression_bounds_walker import ExpressionBoundsVisitor
from pyomo.core.base.component import ComponentBase
from pyomo.core.base.var import VarData
from pyomo.core.expr import Expr_if, MonomialTermExpression
from pyomo.core.expr.compare import compare_expressions
from pyomo.core.expr.numvalue import native_numeric_types, native_types


def holds_variable(expression: Any) -> bool:
    """True when the expression may hold a variable, fixed or not."""
    return expression.__class__ not in native_numeric_types and expression.is_potentially_variable()


def is_plain_variable(expression: Any) -> bool:
    """True for one variable (a scalar or one index), False for an expression or an indexed component."""
    if isinstance(expression, VarData):  # nearly always; the questions below find the variables of other packages
        return True
    if expression.__class__ in native_types or not hasattr(expression, "is_variable_type"):
        return False
    # "is True": a slice answers every question with another slice, which counts as true.
    return expression.is_variable_type() is True and expression.is_numeric_type()


def is_bare_expression(expression: Any) -> bool:
    """True for one numeric expression or parameter that is no plain variable and no relation."""
    if (
        expression.__class__ in native_types
        or not hasattr(expression, "is_numeric_type")
        or is_indexed_component(expression)
    ):
        return False
    return expression.is_numeric_type() is True and not is_plain_variable(expression)


def is_indexed_component(expression: Any) -> bool:
    """True for a family of variables or expressions, such as an indexed Var."""
    return isinstance(expression, ComponentBase) and expression.is_indexed()


def never_changes(expression: Any) -> bool:
    """True for numbers, immutable parameters and expressions of these."""
    if expression.__class__ in native_types or not expression.is_expression_type():
        return expression.__class__ in native_types or expression.is_constant()
    return all(map(never_changes, expression.args))


def same_expression(first: Any, second: Any) -> bool:
    """True when two expressions are built alike from the same variables, parameters and numbers."""
    if first is second:
        return True
    if all(one.__class__ not in native_types and one.is_expression_type() for one in (first, second)):
        return bool(compare_expressions(first, second))
    return first.__class__ in native_types and second.__class__ in native_types and bool(first == second)


def new_leaves(stack: list[Any], seen: set[int]) -> Iterator[Any]:
    """Every number that is NaN, and every parameter and variable that is not yet in `seen`, of a list of expressions.

    What several expressions share is entered with the first of them only: `seen` may outlive the call. The list
    is used up. Nearly all nodes are terms of sums, which are taken apart here and not put on the stack.
    """
    while stack:
        node = stack.pop()
        if node.__class__ is MonomialTermExpression:
            coefficient, node = node.args
            if coefficient.__class__ not in native_types:
                stack.append(coefficient)
            elif coefficient != coefficient:
                yield coefficient
        if node.__class__ in native_types:
            if node != node:
                yield node
        elif id(node) not in seen:
            seen.add(id(node))
            if isinstance(node, VarData) or not node.is_expression_type():
                yield node
            else:
                stack.extend(node.args)


def choose(number: Any, where_nonnegative: Any, elsewhere: Any) -> Any:
    """Return the first formula where the number is at least zero, and the second one elsewhere.

    Both are evaluated for arrays, and only the one that is chosen in a solver.
    """
    if hasattr(number, "is_potentially_variable"):
        return Expr_if(IF_=number >= 0, THEN_=where_nonnegative, ELSE_=elsewhere)
    chosen = np.where(np.asarray(number) >= 0, where_nonnegative, elsewhere)
    return chosen if chosen.ndim else chosen.item()


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
