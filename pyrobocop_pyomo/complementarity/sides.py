"""One side of a statement: reading a relation, a plain variable or an expression into "between these bounds".

Impossible sides are refused where they are written, by structure alone. The bound of a relation is found by structure
as well: it is the part that can never hold a variable. The test whether an expression is fixed at the moment would turn
``x >= 0`` into a bound on a constant as soon as somebody fixes ``x``, and would be wrong again after unfixing it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from pyomo.core.base.indexed_component_slice import IndexedComponent_slice
from pyomo.core.expr import EqualityExpression, InequalityExpression, RangedExpression
from pyomo.core.expr.numvalue import native_numeric_types, native_types, value

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.modeling.expressions import (
    holds_variable,
    is_bare_expression,
    is_indexed_component,
    is_plain_variable,
    never_changes,
)

from .statement import ANY_SIGN

BOUND_CHOICES = (None, "lower", "upper", "free", ANY_SIGN)


def check_sides(first: Any, second: Any, choices: tuple[str | None, str | None], pair: Any) -> None:
    """Refuse sides that can never make a statement, whatever the bounds and parameters will be when it is used.

    Refused are objects that are not sides, two equalities, two relations with two bounds, and sides without a bound.
    The parameters are the same as in `forms.form_of`; the name of the pair is read only when a message is written.
    """
    check_side(first, choices[0], pair)
    check_side(second, choices[1], pair)
    if choices[1] == ANY_SIGN:
        if is_bare_expression(first):
            raise ComplementarityError(
                f"'{pair.name}': side '{first}' is a bare expression; of either_zero(first, second) the first side "
                "has a sign. Write expr >= 0."
            )
        return
    for side, other in ((first, second), (second, first)):
        if is_bare_expression(side) and (is_bare_expression(other) or other.__class__ is InequalityExpression):
            raise ComplementarityError(
                f"'{pair.name}': side '{side}' is a bare expression without a bound. Write expr >= 0; a side without "
                "a bound belongs to a range lower <= expr <= upper, or to an equality."
            )
        if side.__class__ is EqualityExpression:
            refuse_equality_with_bounds(side, other, pair)
        if side.__class__ is other.__class__ is RangedExpression:
            raise four_bounds_error(side, other, pair)


def refuse_equality_with_bounds(side: Any, other: Any, pair: Any) -> None:
    """Refuse what would silently be left out: an equality is met whatever the other side does."""
    if other.__class__ in (EqualityExpression, InequalityExpression, RangedExpression):
        count = "three" if other.__class__ is InequalityExpression else "four"
        raise ComplementarityError(
            f"'{pair.name}': side '{side}' is an equality, which leaves nothing to complement in '{other}': {count} "
            "finite bounds, where two are needed. Make it a Constraint of its own, or drop the bound of the other side."
        )


def four_bounds_error(first: Any, second: Any, pair: Any) -> ComplementarityError:
    """Return the refusal of a range against a range."""
    return ComplementarityError(
        f"'{pair.name}': sides '{first}' and '{second}' have four finite bounds, where two are needed. A range "
        "lower <= F <= upper stands against a free side: pass first_bound= or second_bound='free' for a plain variable "
        "whose bounds do not take part in the pair, or make the bounds of that side a Constraint."
    )


def check_side(side: Any, choice: str | None, pair: Any) -> None:
    """Refuse what can never be a side; parameters as for `check_sides`."""
    if choice not in BOUND_CHOICES:
        raise ComplementarityError(
            f"'{pair.name}': unknown bound {choice!r} of a side. Say 'lower', 'upper', 'free' or None."
        )
    kind = side.__class__
    if kind in (InequalityExpression, EqualityExpression, RangedExpression):
        _check_relation(side, pair)
        if choice == ANY_SIGN:
            raise ComplementarityError(
                f"'{pair.name}': the second side of either_zero(first, second) is an expression of any sign, found "
                f"'{side}'. Leave the relation out; a bound of it is a Constraint."
            )
    elif is_bare_expression(side):
        if not holds_variable(side):
            raise ComplementarityError(f"'{pair.name}': {_no_variable(side)}")
    elif not is_plain_variable(side):
        raise ComplementarityError(f"'{pair.name}': {_why_no_side(side)}")
    if choice not in (None, ANY_SIGN) and not is_plain_variable(side):
        raise ComplementarityError(
            f"'{pair.name}': a bound '{choice}' was chosen for the side '{side}'. The choice is for a plain variable: "
            "leave it out, or pass the variable alone."
        )


def _check_relation(side: Any, pair: Any) -> None:
    # An equality knows no strictness, and a range has one for either end.
    strict = getattr(side, "strict", False)
    if strict is True or (strict.__class__ is tuple and any(strict)):
        raise ComplementarityError(
            f"'{pair.name}': side '{side}' is a strict inequality; a solver cannot hold one. Write >= or <=."
        )
    if side.__class__ is RangedExpression:
        lower, body, upper = side.args
        if not holds_variable(body):
            raise ComplementarityError(f"'{pair.name}': {_no_variable(side)}")
        for bound in (lower, upper):
            if holds_variable(bound):
                raise ComplementarityError(
                    f"'{pair.name}': the bound '{bound}' of side '{side}' holds a variable; bounds of a range are "
                    "numbers and parameters. Write two pairs with a multiplier each, one for 'expr >= lower' and one "
                    "for 'expr <= upper'."
                )
    elif not any(map(holds_variable, side.args)):
        raise ComplementarityError(f"'{pair.name}': {_no_variable(side)}")


def _no_variable(side: Any) -> str:
    return f"side '{side}' holds no variable, so there is nothing to decide. Leave the pair out."


def _why_no_side(side: Any) -> str:
    kind = side.__class__
    if side is None or kind in native_types:
        return (
            f"a side is the constant {side!r}; a pair needs two sides such as 'x >= 0' that hold a variable. "
            "To leave a pair out, return Complementarity.Skip."
        )
    if isinstance(side, IndexedComponent_slice) or is_indexed_component(side):
        return (
            f"side '{side}' stands for many variables. Pass a rule that gives one pair per index, such as "
            "lambda m, i: complements(m.x[i], m.y[i])."
        )
    return f"a side is {side!r} of type {kind.__name__}; expected a relation such as 'x >= 0' or a variable."


class ParsedSide(NamedTuple):
    """A side as it was read.

    Attributes
    ----------
    given : object
        The side as it was written.
    body : Pyomo expression
        The bounded expression.
    lower, upper : number, Pyomo expression or None
        Its bounds; None where there is none, or an infinite one.
    own : tuple of two, or None
        The variable's own bounds where the body is a plain variable. They are read once, since Pyomo computes them
        from the bounds and the domain each time.
    """

    given: Any
    body: Any
    lower: Any = None
    upper: Any = None
    own: tuple[Any, Any] | None = None

    @property
    def is_variable(self) -> bool:
        """Whether it was given as a plain variable, which stands for its own bounds."""
        return self.given is self.body and self.own is not None

    @property
    def bounds(self) -> int:
        """How many finite bounds it has."""
        return (self.lower is not None) + (self.upper is not None)


def read_side(side: Any, choice: str | None, pair: Any) -> ParsedSide:
    """Read one side that `check_sides` accepts; `choice` says which bound of a plain variable is meant.

    Raises
    ------
    ComplementarityError
        If a bound is NaN, has no value or can never be met, or if the chosen bound of a
        plain variable does not exist.
    """
    kind = side.__class__
    if kind is InequalityExpression:
        return _read_relation(side, pair)
    if kind is EqualityExpression:
        return ParsedSide(side, side.arg(0) - side.arg(1), 0, 0)
    if kind is RangedExpression:
        lower, body, upper = side.args
        lower = _bound(lower, "lower", side, pair)
        return ParsedSide(side, body, lower, _bound(upper, "upper", side, pair), _own(body))
    if is_plain_variable(side):
        return _read_variable(side, choice, pair)
    return ParsedSide(side, side)


def _read_relation(side: Any, pair: Any) -> ParsedSide:
    left, right = side.args
    left_varies, right_varies = holds_variable(left), holds_variable(right)
    if left_varies and right_varies:
        return ParsedSide(side, right - left, lower=0)
    if right_varies:
        return ParsedSide(side, right, _bound(left, "lower", side, pair), None, _own(right))
    return ParsedSide(side, left, None, _bound(right, "upper", side, pair), _own(left))


def _read_variable(variable: Any, choice: str | None, pair: Any) -> ParsedSide:
    own = (variable.lower, variable.upper)
    lower = _bound(own[0], "lower", variable, pair) if choice in (None, "lower") else None
    upper = _bound(own[1], "upper", variable, pair) if choice in (None, "upper") else None
    if choice in ("lower", "upper") and lower is upper is None:
        raise ComplementarityError(
            f"'{pair.name}': side '{variable}' has no finite {choice} bound, which was chosen. "
            f"Set it, for example by {variable}.set{choice[0]}b(0), or write a relation such as '{variable} >= 0'."
        )
    return ParsedSide(variable, variable, lower, upper, own)


def _own(body: Any) -> tuple[Any, Any] | None:
    return (body.lower, body.upper) if is_plain_variable(body) else None


def above_lower(side: ParsedSide) -> tuple[Any, Any]:
    """Return ``body - lower`` and the row that keeps it nonnegative, None where the variable's own bound does.

    Where the bound is the number zero the expression is the bare body, so that the product of two plain
    variables stays a bilinear term. Fixed variables stay in the expressions: their values may change.
    """
    return _difference(side.body, side.lower), _row(side, "lower")


def below_upper(side: ParsedSide) -> tuple[Any, Any]:
    """Return ``upper - body`` and the row that keeps it nonnegative, as `above_lower` does."""
    return _difference(side.upper, side.body), _row(side, "upper")


def _row(side: ParsedSide, which: str) -> Any:
    if side.is_variable or _implied(side, which):
        return None
    if side.given.__class__ is InequalityExpression:
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
    if bound.__class__ in native_numeric_types or not never_changes(bound):
        return bound
    return value(bound)


def _implied(side: ParsedSide, which: str) -> bool:
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
