"""How far rows and relations are from holding, at the values that their variables have."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from pyomo.core.base.constraint import Constraint, ConstraintData
from pyomo.core.expr.relational_expr import RelationalExpression

from .shared_nodes import shared_value


def number_or_nan(expression: Any, without: float = math.nan) -> float:
    """Value of an expression; NaN where it has none or is no real number, `without` for None."""
    if expression is None:
        return without
    try:
        number = shared_value(expression, exception=False)
        return math.nan if number is None or isinstance(number, complex) else float(number)
    except (ArithmeticError, ValueError, TypeError):
        return math.nan


def bound_violation(number: float, lower: float | None, upper: float | None) -> float:
    """Distance of a number from an interval; infinite for NaN."""
    if math.isnan(number):
        return math.inf
    below = lower - number if lower is not None else 0.0
    above = number - upper if upper is not None else 0.0
    return float(max(below, above, 0.0))


def constraint_violation(row: Any) -> float:
    """How far a row of a `Constraint` is from holding; NaN where a variable has no value."""
    body = number_or_nan(row.body)
    return body if math.isnan(body) else bound_violation(body, row.lb, row.ub)


def largest_violation(rows: Iterable[Any]) -> float:
    """The largest of several rows; NaN where a variable has no value."""
    violations = [constraint_violation(row) for row in rows]
    return math.nan if any(map(math.isnan, violations)) else max(violations, default=0.0)


def sides_of_row(row: Any) -> tuple[Any, Any, Any]:
    """Body and bounds of a row that a rule returned, in the orientation that Pyomo gives it."""
    if row is Constraint.Skip or row is Constraint.Feasible:
        return 0.0, -math.inf, math.inf
    row = row if isinstance(row, (tuple, RelationalExpression)) else (row, 0.0)  # an expression which is zero
    parts = row if isinstance(row, tuple) else row.args
    # Of two bounds both may change with the time, which a constraint refuses.
    lower, body, upper = parts if len(parts) == 3 else ConstraintData(row).to_bounded_expression()
    return body, -math.inf if lower is None else lower, math.inf if upper is None else upper


def relation_violation(relation: Any, unknown: float | None = None) -> float:
    """How far what a rule returns is from holding: a relation, a tuple as Pyomo takes it, or what has to be zero.

    Parameters
    ----------
    relation : expression, tuple or number
    unknown : float, optional
        Returned where a value is not known; by default that is an error.

    Raises
    ------
    ValueError
        When a variable has no value.
    """
    sides = sides_of_row(relation)
    if unknown is None:
        return bound_violation(*(float(shared_value(side)) for side in sides))
    numbers = list(map(number_or_nan, sides))
    return unknown if any(map(math.isnan, numbers)) else bound_violation(*numbers)
