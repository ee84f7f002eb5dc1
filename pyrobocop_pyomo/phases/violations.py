"""How far what a rule answered is from holding, at the values that its variables have."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

from pyomo.core.base.constraint import Constraint
from pyomo.core.expr.numvalue import value
from pyomo.core.expr.relational_expr import EqualityExpression, RelationalExpression

from pyrobocop_pyomo.complementarity import form_of, side_values

from .record import Statement


def violation(row: Any) -> float:
    """How far a stated relation is from holding."""
    if row is Constraint.Skip:
        return 0.0
    if isinstance(row, RelationalExpression):
        terms = [float(value(term)) for term in row.args]
        if isinstance(row, EqualityExpression):
            return abs(terms[0] - terms[1])
        return max(outside(smaller, None, larger) for smaller, larger in pairwise(terms))
    if isinstance(row, tuple):
        lower, body, upper = (row[1], row[0], row[1]) if len(row) == 2 else row
        return outside(*(None if each is None else float(value(each)) for each in (body, lower, upper)))  # type: ignore[arg-type]
    return abs(float(value(row)))


def outside(number: float, lower: float | None, upper: float | None) -> float:
    """Distance of a number from an interval; what is no number is infinitely far away."""
    if math.isnan(number):
        return math.inf
    below = lower - number if lower is not None else 0.0
    above = number - upper if upper is not None else 0.0
    return float(max(below, above, 0.0))


def sides(pair: Any, statement: Statement) -> tuple[list[tuple[float, float]], float]:
    """Values of both sides of the pairs that a statement makes, and how far the rows beside them are from holding."""
    first, second, *choices = pair
    form = form_of(statement, first, second, (choices[0], choices[1]) if choices else (None, None))
    return [side_values(each) for each in form.pairs], max(map(violation, form.rows), default=0.0)
