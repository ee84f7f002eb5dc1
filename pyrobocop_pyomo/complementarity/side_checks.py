"""What can never be a side, or two sides of one statement: refused where it is written, by structure alone."""

from __future__ import annotations

from typing import Any

from pyomo.core.base.component import ComponentBase
from pyomo.core.base.indexed_component_slice import IndexedComponent_slice
from pyomo.core.base.var import VarData
from pyomo.core.expr import EqualityExpression, InequalityExpression, RangedExpression
from pyomo.core.expr.numvalue import native_numeric_types, native_types

from pyrobocop_pyomo.errors import ComplementarityError

BOUND_CHOICES = (None, "lower", "upper", "free")


def check_sides(first: Any, second: Any, choices: tuple[str | None, str | None], pair: Any) -> None:
    """Refuse what can never be a statement, whatever the bounds and parameters will be when it is used.

    Parameters
    ----------
    first, second : object
        The sides as the user wrote them.
    choices : pair of {None, "lower", "upper", "free"}
        Which bound of a plain variable is meant.
    pair : component data
        Whose sides they are; asked for its name only when a message is written.

    Raises
    ------
    ComplementarityError
        If one is no side, if two equalities or two relations with two bounds meet, or if nothing bounds them.
    """
    check_side(first, choices[0], pair)
    check_side(second, choices[1], pair)
    for side, other in ((first, second), (second, first)):
        if is_bare(side) and (is_bare(other) or other.__class__ is InequalityExpression):
            raise ComplementarityError(
                f"'{pair.name}': side '{side}' is a bare expression without a bound. Write expr >= 0; a side without "
                "a bound belongs to a range lower <= expr <= upper, or to an equality."
            )
        if side.__class__ is EqualityExpression:
            refuse_equality_with_bounds(side, other, pair)
        if side.__class__ is other.__class__ is RangedExpression:
            raise four_bounds(side, other, pair)


def refuse_equality_with_bounds(side: Any, other: Any, pair: Any) -> None:
    """Refuse what would silently be left out: an equality is met whatever the other side does."""
    if other.__class__ in (EqualityExpression, InequalityExpression, RangedExpression):
        count = "three" if other.__class__ is InequalityExpression else "four"
        raise ComplementarityError(
            f"'{pair.name}': side '{side}' is an equality, which leaves nothing to complement in '{other}': {count} "
            "finite bounds, where two are needed. Make it a Constraint of its own, or drop the bound of the other side."
        )


def four_bounds(first: Any, second: Any, pair: Any) -> ComplementarityError:
    """Return the refusal of a range against a range."""
    return ComplementarityError(
        f"'{pair.name}': sides '{first}' and '{second}' have four finite bounds, where two are needed. A range "
        "lower <= F <= upper stands against a free side: pass first_bound= or second_bound='free' for a plain variable "
        "whose bounds are just bounds, or make the bounds of that side a Constraint."
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
        if choice is not None:
            raise ComplementarityError(
                f"'{pair.name}': a bound '{choice}' was chosen for the side '{side}', which states its own. "
                "The choice is for a plain variable: leave it out, or pass the variable alone."
            )
    elif is_bare(side):
        if not holds_variable(side):
            raise ComplementarityError(f"'{pair.name}': {_no_variable(side)}")
        if choice is not None:
            raise ComplementarityError(
                f"'{pair.name}': a bound '{choice}' was chosen for the side '{side}', which has none. "
                "The choice is for a plain variable: leave it out."
            )
    elif not is_plain_variable(side):
        raise ComplementarityError(f"'{pair.name}': {_why_no_side(side)}")


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
    if side is None:
        return (
            "a side is None; a pair needs two sides such as 'x >= 0'. To leave a pair out, return Complementarity.Skip."
        )
    if kind in native_types:
        return (
            f"a side is the constant {side!r}; a pair needs two sides such as 'x >= 0' that hold a variable. "
            "To leave a pair out, return Complementarity.Skip."
        )
    if isinstance(side, IndexedComponent_slice) or is_indexed_component(side):
        return (
            f"side '{side}' stands for many variables. Index the Complementarity over the same set and pass both "
            "sides whole as expr=complements(x, y), or pass one variable of it per pair."
        )
    return f"a side is {side!r} of type {kind.__name__}; expected a relation such as 'x >= 0' or a variable."


def holds_variable(expression: Any) -> bool:
    """True when the expression may hold a variable, fixed or not."""
    return expression.__class__ not in native_numeric_types and expression.is_potentially_variable()


def is_plain_variable(side: Any) -> bool:
    """True for one variable (a scalar or one index), False for an expression or an indexed component."""
    if isinstance(side, VarData):  # nearly always; the questions below find the variables of other packages
        return True
    if side.__class__ in native_types or not hasattr(side, "is_variable_type"):
        return False
    # "is True": a slice answers every question with another slice, which counts as true.
    return side.is_variable_type() is True and side.is_numeric_type()


def is_bare(side: Any) -> bool:
    """True for one numeric expression or parameter that is no plain variable and no relation."""
    if side.__class__ in native_types or not hasattr(side, "is_numeric_type") or is_indexed_component(side):
        return False
    return side.is_numeric_type() is True and not is_plain_variable(side)


def is_indexed_component(side: Any) -> bool:
    """True for a family of variables or expressions, such as an indexed Var."""
    return isinstance(side, ComponentBase) and side.is_indexed()


def same_expression(first: Any, second: Any) -> bool:
    """True when two expressions are built alike from the same variables, parameters and numbers."""
    stack = [(first, second)]
    while stack:
        one, other = stack.pop()
        if one is other:
            continue
        if one.__class__ in native_types or other.__class__ in native_types:
            if one.__class__ not in native_types or other.__class__ not in native_types or one != other:
                return False
        elif not one.is_expression_type() or _shape(one) != _shape(other):
            return False
        else:
            stack.extend(zip(one.args, other.args, strict=True))
    return True


def _shape(expression: Any) -> tuple[Any, ...]:
    # With the name: sin and cos have one class.
    is_expression = expression.is_expression_type()
    return (expression.__class__, expression.getname(), expression.nargs() if is_expression else 0)
