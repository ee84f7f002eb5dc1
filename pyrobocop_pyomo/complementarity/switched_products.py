"""Rows that say that a product is zero."""

from __future__ import annotations

from math import isfinite
from typing import Any

from pyomo.core.expr.numeric_expr import NegationExpression, ProductExpression
from pyomo.core.expr.numvalue import native_types, value

from pyrobocop_pyomo.modeling.expression_bounds import ExpressionBounds
from pyrobocop_pyomo.modeling.expressions import holds_variable


def is_zero_product(row: Any) -> bool:
    """Whether a row says that the product of two factors with variables is zero.

    Such are ``a * b == 0`` and, where no factor is negative by the bounds of its variables, ``a * b <= 0``. Numbers
    before the product are left out.
    """
    lower, upper = (_finite(bound) for bound in (row.lower, row.upper))
    body = without_number(row.body)
    if upper != 0.0 or lower not in (0.0, None) or not isinstance(body, ProductExpression):
        return False
    if lower is None and not (body is row.body and all(interval_of(factor)[0] >= 0.0 for factor in body.args)):
        return False
    first, second = map(without_number, body.args)
    return holds_variable(first) and holds_variable(second) and first is not second


def interval_of(expression: Any) -> tuple[float, float]:
    """By interval arithmetic, from the declared bounds of variables: fixed ones may be freed again."""
    return ExpressionBounds(use_fixed_var_values_as_bounds=False).walk_expression(expression)


def without_number(expression: Any) -> Any:
    """An expression without its sign and the number before it; as it is where that number is zero or unknown."""
    while expression.__class__ not in native_types and expression.is_expression_type():
        if isinstance(expression, NegationExpression):
            expression = expression.arg(0)
        elif isinstance(expression, ProductExpression) and _finite(expression.arg(0)):
            expression = expression.arg(1)
        else:
            break
    return expression


def _finite(number: Any) -> float | None:
    """The value of what holds no variable, where it is finite."""
    if number is None or holds_variable(number):
        return None
    known = value(number, exception=False)
    return None if known is None or not isfinite(known) else float(known)
