"""Sides as variables: which side is one already, and the generated variable that stands for any other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pyomo.core.expr import LinearExpression, MonomialTermExpression, SumExpression
from pyomo.core.expr.numvalue import native_numeric_types, value

from .canonical import CanonicalPair
from .side_checks import is_plain_variable


@dataclass(frozen=True, eq=False)
class SideVariable:
    """A side that is a variable but for its sign and an offset: ``side = sign * (variable - offset)``.

    Attributes
    ----------
    variable : VarData
        Of the user, or generated.
    sign : float
        +1 or -1.
    offset : number or Pyomo expression
        Without variables; may hold mutable parameters.
    """

    variable: Any
    sign: float
    offset: Any


@dataclass(frozen=True, eq=False)
class LiftedPair:
    """A pair whose sides are variables.

    Attributes
    ----------
    pair : CanonicalPair
        As stated; its sides are the original expressions.
    a, b : SideVariable
        What stands for the sides in the generated rows. Of a part of a side, the variable of that part.
    """

    pair: CanonicalPair
    a: SideVariable
    b: SideVariable


def side_variable(side: Any) -> SideVariable | None:
    """Read ``x``, ``-x``, ``x - c`` or ``c - x`` as a variable; None when the side is anything else.

    A variable is recognised by structure and not by what is fixed at the moment, so the answer stays true when
    variables are fixed or unfixed later.
    """
    if side.__class__ not in (LinearExpression, SumExpression):
        term = _signed_variable(side)
        return None if term is None else SideVariable(term[0], term[1], 0.0)
    arguments = side.args
    if len(arguments) != 2:
        return None
    for varying, constant in (arguments, arguments[::-1]):
        if constant.__class__ in native_numeric_types or not constant.is_potentially_variable():
            term = _signed_variable(varying)
            if term is not None:
                variable, sign = term
                # sign * (x - offset) = sign * x + constant
                return SideVariable(variable, sign, -constant if sign > 0 else constant)
    return None


def _signed_variable(term: Any) -> tuple[Any, float] | None:
    if is_plain_variable(term):
        return term, 1.0
    if term.__class__ is MonomialTermExpression:
        coefficient, variable = term.args
        if coefficient.__class__ in native_numeric_types and coefficient in (1, -1):
            return variable, float(coefficient)
    return None


def part_values(side: Any) -> tuple[float, float]:
    """Return ``max(side, 0)`` and ``max(-side, 0)`` at the current values; zeros where the side has no value."""
    try:
        number = _number(side)
    except (ArithmeticError, ValueError):  # outside of a function's domain
        number = None
    if number is None or isinstance(number, complex) or number != number:
        return 0.0, 0.0
    number = float(number)
    return (number, 0.0) if number > 0 else (0.0, -number)


def _number(side: Any) -> Any:
    """The value of a side, None where it has none.

    Most sides that are lifted are affine. They are summed up here: Pyomo's general walk takes five times as long, and
    longer than everything else that is done for a lifted side.
    """
    if side.__class__ is not LinearExpression:
        return value(side, exception=False)
    total: Any = 0
    for term in side.args:
        if term.__class__ is MonomialTermExpression:
            coefficient, variable = term.args
            number = variable.value
            if coefficient.__class__ not in native_numeric_types:
                coefficient = value(coefficient, exception=False)
            if coefficient is None or number is None:
                return None
            total += coefficient * number
        else:
            number = term if term.__class__ in native_numeric_types else value(term, exception=False)
            if number is None:
                return None
            total += number
    return total
