"""One side of a pair: reading ``expr >= c``, ``expr <= c`` or a plain variable into "this is nonnegative".

The bound is found by the *structure* of the relation: what can never hold a variable is the bound. Asking
whether an expression is fixed at the moment would turn ``x >= 0`` into a bound on a constant as soon as
somebody fixes ``x``, and would be wrong again after unfixing it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from pyomo.core.base.component import ComponentBase
from pyomo.core.base.indexed_component_slice import IndexedComponent_slice
from pyomo.core.expr import EqualityExpression, InequalityExpression, RangedExpression
from pyomo.core.expr.numvalue import native_numeric_types, native_types, value

from pyrobocop_pyomo.errors import ComplementarityError

BOUND_CHOICES = (None, "lower", "upper")


class Side(NamedTuple):
    """A side in canonical form.

    Attributes
    ----------
    expression : Pyomo expression
        Nonnegative where the side holds.
    row : relational expression or None
        What has to be added as a constraint so that it holds; None where a variable's own bound does it.
    """

    expression: Any
    row: Any


def check_side(side: Any, choice: str | None, pair: Any) -> None:
    """Refuse what can never be a side, whatever the bounds and parameters will be when it is used.

    Parameters
    ----------
    side : object
        The side as the user wrote it.
    choice : {None, "lower", "upper"}
        Which bound of a plain variable is meant.
    pair : component data
        Whose side it is; asked for its name only when a message is written.

    Raises
    ------
    ComplementarityError
        If the side is not a one-sided relation of an expression with a variable, nor a plain variable.
    """
    if choice not in BOUND_CHOICES:
        raise ComplementarityError(f"'{pair.name}': unknown bound {choice!r} of a side. Say 'lower', 'upper' or None.")
    kind = side.__class__
    if kind is InequalityExpression:
        if side.strict:
            raise ComplementarityError(
                f"'{pair.name}': side '{side}' is a strict inequality; a solver cannot hold one. Write >= or <=."
            )
        if not (holds_variable(side.arg(0)) or holds_variable(side.arg(1))):
            raise ComplementarityError(
                f"'{pair.name}': side '{side}' holds no variable, so there is nothing to decide."
            )
        if choice is not None:
            raise ComplementarityError(
                f"'{pair.name}': a bound '{choice}' was chosen for the side '{side}', which states its own. "
                "The choice is for a plain variable: leave it out, or pass the variable alone."
            )
    elif not is_plain_variable(side):
        raise ComplementarityError(f"'{pair.name}': {_why_no_side(side)}")


def _why_no_side(side: Any) -> str:
    kind = side.__class__
    if side is None:
        return (
            "a side is None; a pair needs two sides such as 'x >= 0'. To leave a pair out, return Complementarity.Skip."
        )
    if kind in native_types:
        return (
            f"a side is the constant {side!r}; a pair needs two sides such as 'x >= 0' that hold a variable. "
            "To leave a pair out, return Complementarity.Skip."
        )
    if kind is EqualityExpression:
        return f"side '{side}' is an equality, which leaves nothing to complement. Make it a Constraint."
    if kind is RangedExpression:
        return (
            f"side '{side}' has two bounds; a side has one. Write two pairs with a multiplier each, "
            "one for 'expr >= lower' and one for 'expr <= upper'."
        )
    if isinstance(side, IndexedComponent_slice) or (isinstance(side, ComponentBase) and side.is_indexed()):
        return f"side '{side}' stands for many variables. Index the Complementarity and pass one of them per pair."
    if hasattr(side, "is_expression_type") and side.is_numeric_type():
        return f"side '{side}' is a bare expression without a bound. Write expr >= 0."
    return f"a side is {side!r} of type {kind.__name__}; expected a relation such as 'x >= 0' or a variable."


def canonical_side(side: Any, choice: str | None, pair: Any) -> Side:
    """Bring one side into the form ``expression >= 0``.

    Where the bound is the number zero the expression is the bare side, so that the product of two plain
    variables stays a bilinear term. Fixed variables stay in the expressions: their values may change.

    Parameters
    ----------
    side, choice, pair
        As for `check_side`.

    Raises
    ------
    ComplementarityError
        If the side has no finite bound, or a plain variable has two and none was chosen.
    """
    if side.__class__ is not InequalityExpression or side.strict or choice is not None:
        check_side(side, choice, pair)
        return _variable_side(side, choice, pair)
    left, right = side.args
    left_varies = holds_variable(left)
    right_varies = holds_variable(right)
    if left_varies and right_varies:
        return Side(right - left, side)
    if right_varies:
        bound = _finite(left, right, pair)
        return Side(_difference(right, bound), None if _implied(right, "lower", left) else side)
    if left_varies:
        bound = _finite(right, left, pair)
        return Side(_difference(bound, left), None if _implied(left, "upper", right) else side)
    check_side(side, choice, pair)
    raise AssertionError("check_side refuses a relation without variables")


def _variable_side(variable: Any, choice: str | None, pair: Any) -> Side:
    lower, upper = variable.lb, variable.ub
    if choice is None:
        if lower is not None and upper is not None:
            raise ComplementarityError(
                f"'{pair.name}': side '{variable}' has two finite bounds, {lower:g} and {upper:g}; one is meant. "
                f"Write '{variable} >= {lower:g}' or '{variable} <= {upper:g}', or pass complements(..., "
                "first_bound=) or (..., second_bound=) 'lower' or 'upper'."
            )
        choice = "lower" if lower is not None else "upper"
    number = lower if choice == "lower" else upper
    if number is None:
        which = "finite bound" if lower is upper is None else f"finite {choice} bound"
        raise ComplementarityError(
            f"'{pair.name}': side '{variable}' has no {which}; a complementary side needs one. "
            f"Set it, for example by {variable}.setlb(0), or write a relation such as '{variable} >= 0'."
        )
    if choice == "lower":
        return Side(_difference(variable, _simplified(variable.lower)), None)
    return Side(_difference(_simplified(variable.upper), variable), None)


def holds_variable(expression: Any) -> bool:
    """True when the expression may hold a variable, fixed or not."""
    return expression.__class__ not in native_numeric_types and expression.is_potentially_variable()


def is_plain_variable(side: Any) -> bool:
    """True for one variable (a scalar or one index), False for an expression or an indexed component."""
    if side.__class__ in native_types or not hasattr(side, "is_variable_type"):
        return False
    # "is True": a slice answers every question with another slice, which counts as true.
    return side.is_variable_type() is True and side.is_numeric_type()


def _simplified(bound: Any) -> Any:
    """Turn what can never change into its number: a domain and a bound together make a max(0, 0)."""
    if bound.__class__ in native_numeric_types or not _never_changes(bound):
        return bound
    return value(bound)


def _never_changes(bound: Any) -> bool:
    if bound.__class__ in native_types or not bound.is_expression_type():
        return bound.__class__ in native_types or bound.is_constant()
    return all(map(_never_changes, bound.args))


def _difference(larger: Any, smaller: Any) -> Any:
    if smaller.__class__ in native_numeric_types and smaller == 0:
        return larger
    if larger.__class__ in native_numeric_types and larger == 0:
        return -smaller
    return larger - smaller


def _finite(bound: Any, side: Any, pair: Any) -> Any:
    bound = _simplified(bound)
    number = bound if bound.__class__ in native_numeric_types else value(bound, exception=False)
    # A parameter without a value yet may still get one; the model cannot be written before.
    if number is not None and not math.isfinite(number):
        raise ComplementarityError(
            f"'{pair.name}': side '{side}' has the infinite bound {number}; a side needs a finite one."
        )
    return bound


def _implied(side: Any, which: str, bound: Any) -> bool:
    """True when the side is a plain variable whose own bound enforces the stated one, now and later."""
    if not is_plain_variable(side):
        return False
    own = side.lower if which == "lower" else side.upper
    if own is None:
        return False
    if own is bound:
        return True
    own, bound = _simplified(own), _simplified(bound)
    if own.__class__ not in native_numeric_types or bound.__class__ not in native_numeric_types:
        return False  # a parameter may move past the other one
    return own >= bound if which == "lower" else own <= bound
