"""One side of a statement: reading a relation, a plain variable or an expression into "between these bounds".

The bound is found by the *structure* of the relation: what can never hold a variable is the bound. Asking
whether an expression is fixed at the moment would turn ``x >= 0`` into a bound on a constant as soon as
somebody fixes ``x``, and would be wrong again after unfixing it.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import Any, NamedTuple

from pyomo.core.expr import EqualityExpression, InequalityExpression, RangedExpression
from pyomo.core.expr.numvalue import native_numeric_types, native_types, value

from pyrobocop_pyomo.errors import ComplementarityError

from .side_checks import check_side, holds_variable, is_plain_variable


class Kind(Enum):
    """What the user wrote as a side."""

    RELATION = "a relation with one bound"
    RANGE = "a relation with two bounds"
    EQUALITY = "an equality"
    VARIABLE = "a plain variable"
    EXPRESSION = "a bare expression"


class Side(NamedTuple):
    """A side as it was read.

    Attributes
    ----------
    kind : Kind
        What it was written as.
    given : object
        As it was written.
    body : Pyomo expression
        What is bounded.
    lower, upper : number, Pyomo expression or None
        Its bounds; None where there is none, or an infinite one.
    infinite : float or None
        The infinite bound that was stated and counts as none, for messages.
    own : tuple of two, or None
        The bounds that the variable has where the body is a plain one. They are read once: Pyomo puts them together
        from the bounds and the domain each time.
    """

    kind: Kind
    given: Any
    body: Any
    lower: Any = None
    upper: Any = None
    infinite: float | None = None
    own: tuple[Any, Any] | None = None

    @property
    def bounds(self) -> int:
        """How many finite bounds it has."""
        return (self.lower is not None) + (self.upper is not None)


def read_side(side: Any, choice: str | None, pair: Any) -> Side:
    """Read one side.

    Parameters
    ----------
    side : relational expression, variable or expression
        As the user wrote it.
    choice : {None, "lower", "upper", "free"}
        Which bound of a plain variable is meant.
    pair : component data
        Whose side it is; asked for its name only when a message is written.

    Raises
    ------
    ComplementarityError
        If it can be no side, if a bound is NaN, has no value or can never be met, or if the chosen bound of a
        plain variable does not exist.
    """
    kind = side.__class__
    if kind is InequalityExpression and choice is None and not side.strict:
        return _read_relation(side, pair)
    check_side(side, choice, pair)
    if kind is EqualityExpression:
        return Side(Kind.EQUALITY, side, side.arg(0) - side.arg(1), 0, 0)
    if kind is RangedExpression:
        lower, body, upper = side.args
        lower = _bound(lower, "lower", side, pair)
        return Side(Kind.RANGE, side, body, lower, _bound(upper, "upper", side, pair), None, _own(body))
    if is_plain_variable(side):
        return _read_variable(side, choice, pair)
    return Side(Kind.EXPRESSION, side, side)


def _read_relation(side: Any, pair: Any) -> Side:
    left, right = side.args
    left_varies, right_varies = holds_variable(left), holds_variable(right)
    if left_varies and right_varies:
        return Side(Kind.RELATION, side, right - left, lower=0)
    if right_varies:
        bound = _bound(left, "lower", side, pair)
        return Side(Kind.RELATION, side, right, bound, None, -math.inf if bound is None else None, _own(right))
    if left_varies:
        bound = _bound(right, "upper", side, pair)
        return Side(Kind.RELATION, side, left, None, bound, math.inf if bound is None else None, _own(left))
    check_side(side, None, pair)
    raise AssertionError("check_side refuses a relation without variables")


def _read_variable(variable: Any, choice: str | None, pair: Any) -> Side:
    own = (variable.lower, variable.upper)
    lower = _bound(own[0], "lower", variable, pair) if choice not in ("upper", "free") else None
    upper = _bound(own[1], "upper", variable, pair) if choice not in ("lower", "free") else None
    if choice in ("lower", "upper") and lower is upper is None:
        raise ComplementarityError(
            f"'{pair.name}': side '{variable}' has no finite {choice} bound, which was chosen. "
            f"Set it, for example by {variable}.set{choice[0]}b(0), or write a relation such as '{variable} >= 0'."
        )
    return Side(Kind.VARIABLE, variable, variable, lower, upper, None, own)


def _own(body: Any) -> tuple[Any, Any] | None:
    return (body.lower, body.upper) if is_plain_variable(body) else None


def above_lower(side: Side) -> tuple[Any, Any]:
    """Return ``body - lower`` and the row that keeps it nonnegative, None where the variable's own bound does.

    Where the bound is the number zero the expression is the bare body, so that the product of two plain
    variables stays a bilinear term. Fixed variables stay in the expressions: their values may change.
    """
    return _difference(side.body, side.lower), _row(side, "lower")


def below_upper(side: Side) -> tuple[Any, Any]:
    """Return ``upper - body`` and the row that keeps it nonnegative, as `above_lower` does."""
    return _difference(side.upper, side.body), _row(side, "upper")


def _row(side: Side, which: str) -> Any:
    if side.kind is Kind.VARIABLE or _implied(side, which):
        return None
    if side.kind is Kind.RELATION:
        return side.given
    return side.body >= side.lower if which == "lower" else side.body <= side.upper


def _difference(larger: Any, smaller: Any) -> Any:
    if smaller.__class__ in native_numeric_types and smaller == 0:
        return larger
    if larger.__class__ in native_numeric_types and larger == 0:
        return -smaller
    return larger - smaller


def _bound(bound: Any, which: str, side: Any, pair: Any) -> Any:
    """Return the bound, as a number where it can never change, and None where there is none."""
    if bound is None:
        return None
    if bound.__class__ in native_numeric_types:
        number = bound
    else:
        bound = _simplified(bound)
        number = value(bound, exception=False)
    if number is None:
        raise ComplementarityError(
            f"'{pair.name}': the {which} bound '{bound}' of side '{side}' has no value, so it is not known whether "
            "there is a bound. Give the parameter a value first."
        )
    if math.isfinite(number):
        return bound
    if number == (-math.inf if which == "lower" else math.inf):
        return None
    raise ComplementarityError(
        f"'{pair.name}': side '{side}' has the {which} bound {number:g}, which no value can meet. "
        "Give a finite bound, or leave it out."
    )


def _simplified(bound: Any) -> Any:
    """Turn what can never change into its number: a domain and a bound together make a max(0, 0)."""
    if bound.__class__ in native_numeric_types or not _never_changes(bound):
        return bound
    return value(bound)


def _never_changes(bound: Any) -> bool:
    if bound.__class__ in native_types or not bound.is_expression_type():
        return bound.__class__ in native_types or bound.is_constant()
    return all(map(_never_changes, bound.args))


def _implied(side: Side, which: str) -> bool:
    """True when the side is a plain variable whose own bound enforces the stated one, now and later."""
    if side.own is None:
        return False
    own, bound = (side.own[0], side.lower) if which == "lower" else (side.own[1], side.upper)
    if own is None:
        return False
    if own is bound:
        return True
    own = _simplified(own)
    if own.__class__ not in native_numeric_types or bound.__class__ not in native_numeric_types:
        return False  # a parameter may move past the other one
    return own >= bound if which == "lower" else own <= bound
