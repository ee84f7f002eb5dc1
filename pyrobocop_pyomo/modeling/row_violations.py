"""How far rows and relations are from holding, at the values that their variables have.

Which part of an expression has no value or no derivative at the current values, in words.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint, ConstraintData
from pyomo.core.expr.numeric_expr import DivisionExpression, Expr_ifExpression, PowExpression, UnaryFunctionExpression
from pyomo.core.expr.numvalue import native_numeric_types
from pyomo.core.expr.relational_expr import RelationalExpression

from .expression_nodes import ARRAY_FUNCTIONS
from .expression_steps import ExpressionSteps
from .rows_by_rule import sum_by_rule
from .shared_nodes import NodesOnce, shared_value, variables_in


def number_or_nan(expression: Any, known: Mapping[int, float] | None = None) -> float:
    """Value of an expression; NaN where it has none or is no real number.

    Values of some nodes may be known, by their ids.
    """
    try:
        number = shared_value(expression, exception=False, known=known)
        return math.nan if number is None or isinstance(number, complex) else float(number)
    except (ArithmeticError, ValueError, TypeError):
        return math.nan


def value_of_sum(part: Any) -> float:
    """Value of a named expression that follows a rule; NaN where it has none.

    Its summands are evaluated as arrays. Where three of them differ from what Pyomo has for them, all are Pyomo's.
    """
    by_rule = sum_by_rule(part)
    if by_rule is None:
        return number_or_nan(part)
    repeated = by_rule.repeated()
    arrays = {id(alike[0]): np.array([leaf.value for leaf in alike], dtype=float) for alike in repeated.variables}
    if len(arrays) < len(repeated.variables):
        return number_or_nan(part)  # two of the variables are one at the first place
    try:
        with np.errstate(divide="raise", over="raise", invalid="raise"):
            (summands,) = ExpressionSteps([repeated.expression(0)]).evaluate_at(arrays, ARRAY_FUNCTIONS)
    except (ArithmeticError, ValueError, TypeError):
        return number_or_nan(part)
    count = len(repeated.rows)
    summands, places = np.broadcast_to(summands, count), [0, count // 2, count - 1]
    stated = [number_or_nan(repeated.expression(place)) for place in places]
    if not np.allclose(summands[places], stated, atol=0.0, equal_nan=True):
        return number_or_nan(part)
    return float(np.dot(repeated.scales, summands))


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


def relation_violation(relation: Any, unknown: float) -> float:
    """How far what a rule returns is from holding: a relation, a tuple as Pyomo takes it, or what has to be zero.

    Parameters
    ----------
    relation : expression, tuple or number
    unknown : float
        Returned where a value is not known.
    """
    numbers = list(map(number_or_nan, sides_of_row(relation)))
    return unknown if any(map(math.isnan, numbers)) else bound_violation(*numbers)


# ----------------------------------------------------------------------------------------------------- undefined values


# Longer expressions are named by their variables.
_SHOWN_CHARACTERS, _SHOWN_VARIABLES = 60, 4
# Arguments at which a function has a value and no derivative.
_EDGES = {"sqrt": (0.0,), "asin": (-1.0, 1.0), "acos": (-1.0, 1.0), "acosh": (1.0,)}
_GROWING = ("exp", "sinh", "cosh")
_NO_VALUE = (ArithmeticError, ValueError, TypeError)


@dataclass(frozen=True, eq=False)
class UndefinedPart:
    """The innermost part of an expression that has no value, or no derivative, where its arguments have values.

    Attributes
    ----------
    what : str
        In words, with the numbers.
    argument : expression or number
        What has to have another value.
    """

    what: str
    argument: Any


def undefined_part(expression: Any) -> UndefinedPart | None:
    """The first part of an expression that has no finite value or derivative; None where all have, or a value misses.

    Parameters
    ----------
    expression : expression or number
        Its variables have values.
    """
    found = _Definedness().of(expression)
    return found if isinstance(found, UndefinedPart) else None


class _Definedness(NodesOnce):
    """The value of each node, None where one is missing, or the part of it that has none."""

    def of_leaf(self, leaf: Any) -> Any:
        if getattr(leaf, "value", leaf) is None:
            return None
        number = number_or_nan(leaf)
        if math.isfinite(number):
            return number
        return UndefinedPart(f"the number {number:g} of {leaf.name!r}", leaf)

    def of_operation(self, node: Any, found: list[Any]) -> Any:
        if isinstance(node, Expr_ifExpression) and isinstance(found[0], (bool, float)):
            return found[1] if found[0] else found[2]  # the other side need not have a value
        constants = (each for each in found if each.__class__ in native_numeric_types and not math.isfinite(each))
        for number in constants:  # as values they would have been told of where they arise
            return UndefinedPart(f"the number {number:g}", number)
        undefined = next((each for each in found if isinstance(each, UndefinedPart)), None)
        if undefined is not None or None in found:
            return undefined
        try:
            number = node._apply_operation(found)
        except _NO_VALUE:
            number = math.nan
        number = math.nan if isinstance(number, complex) else float(number)
        return _undefined_here(node, found, number) or number


def _undefined_here(node: Any, numbers: list[float], number: float) -> UndefinedPart | None:
    """What a node lacks at the values of its arguments."""
    if isinstance(node, PowExpression):
        return _power(node, numbers, number)
    if isinstance(node, UnaryFunctionExpression):
        return _function(node, numbers[0], number)
    if math.isfinite(number):
        return None
    if isinstance(node, DivisionExpression):
        return UndefinedPart(f"division by {_equation(node.arg(1), numbers[1])}", node.arg(1))
    return UndefinedPart(f"{_words(node)} is not finite", node)


def _power(node: Any, numbers: Any, number: float) -> UndefinedPart | None:
    base, exponent = numbers
    fraction = exponent != math.floor(exponent)
    what = f"{_equation(node.arg(0), base)} to the power {exponent:g}"
    if not math.isfinite(number):
        return UndefinedPart(what if base <= 0.0 else f"overflow of {what}", node.arg(0))
    if base == 0.0 and fraction and exponent < 2.0:
        which = "derivative" if exponent < 1.0 else "second derivative"
        return UndefinedPart(f"the {which} of {what}", node.arg(0))
    return None


def _function(node: Any, argument: float, number: float) -> UndefinedPart | None:
    name, is_finite = node.getname(), math.isfinite(number)
    if is_finite and argument not in _EDGES.get(name, ()):
        return None
    which = "the derivative of " if is_finite else "overflow of " if name in _GROWING else ""
    return UndefinedPart(f"{which}{name}(...) of {_equation(node.arg(0), argument)}", node.arg(0))


def _equation(argument: Any, number: float) -> str:
    """An expression and its value; a long one by the values of its variables."""
    if not hasattr(argument, "is_expression_type"):
        return f"{number:.6g}"
    text = str(argument)
    return f"{text} = {number:.6g}" if len(text) <= _SHOWN_CHARACTERS else f"{number:.6g}, {_words(argument)}"


def _words(expression: Any) -> str:
    text = str(expression)
    if len(text) <= _SHOWN_CHARACTERS:
        return text
    variables = list(variables_in(expression))
    shown = ", ".join(f"{variable.name} = {number_or_nan(variable):.6g}" for variable in variables[:_SHOWN_VARIABLES])
    more = ", ..." if len(variables) > _SHOWN_VARIABLES else ""
    return f"an expression of {shown}{more}"
