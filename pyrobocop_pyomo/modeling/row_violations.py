"""How far rows and relations are from holding, at the values that their variables have."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

from pyomo.core.base.constraint import Constraint
from pyomo.core.expr.relational_expr import EqualityExpression, RelationalExpression

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
    if relation is Constraint.Skip:
        return 0.0
    is_relation = isinstance(relation, RelationalExpression)
    terms = relation.args if is_relation else relation if isinstance(relation, tuple) else (relation,)
    if unknown is None:
        numbers = [None if term is None else float(shared_value(term)) for term in terms]
    else:
        numbers = [None if term is None else number_or_nan(term) for term in terms]
        if numbers == [None] or any(number is not None and math.isnan(number) for number in numbers):
            return unknown
    if is_relation and not isinstance(relation, EqualityExpression):
        return max(bound_violation(smaller, None, larger) for smaller, larger in pairwise(numbers))  # type: ignore[arg-type]
    if len(numbers) == 3:  # (lower, body, upper)
        lower, body, upper = numbers
        return bound_violation(body, lower, upper)  # type: ignore[arg-type]
    left, right = numbers if len(numbers) == 2 else (numbers[0], 0.0)
    return bound_violation(left - right, 0.0, 0.0)  # type: ignore[operator]
