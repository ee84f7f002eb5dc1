"""Sides as variables: which side is one already, the generated variables that stand for others, and their rows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pyomo.core.expr import LinearExpression, MonomialTermExpression, SumExpression
from pyomo.core.expr.numvalue import native_numeric_types

from pyrobocop_pyomo.modeling.expressions import is_plain_variable
from pyrobocop_pyomo.modeling.row_violations import number_or_nan

from .forms import CanonicalForm, CanonicalPair, SidePart
from .record import RelaxationRecord, RelaxedPair


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
    number = number_or_nan(side)
    return (number if number > 0 else 0.0), (-number if number < 0 else 0.0)


def relaxed_pairs(record: RelaxationRecord, form: CanonicalForm) -> list[RelaxedPair]:
    """Choose the expressions of the sides of a statement, and state the rows that keep their signs."""
    for row in form.rows:
        record.put_row("sides", row, [form.source])
    parts: dict[SidePart, Any] = {}
    relaxed: list[RelaxedPair] = []
    for pair in form.pairs:
        if pair.a_part is not SidePart.WHOLE:
            a = parts[pair.a_part]
        elif relaxed and pair.a is relaxed[0].pair.a:
            a = relaxed[0].a
        else:
            a = _side(record, form, pair.a, pair.a_row)
        if pair.b_part is SidePart.WHOLE:
            b = _side(record, form, pair.b, pair.b_row)
        else:
            parts = parts or _parts(record, form, pair.b)
            b = parts[pair.b_part]
        relaxed.append(RelaxedPair(pair, a, b))
    return relaxed


def _side(record: RelaxationRecord, form: CanonicalForm, side: Any, row: Any) -> Any:
    """Return the expression of one side in the generated rows."""
    if record.lift and side_variable(side) is None:
        variable = record.put_variable(part_values(side)[0])
        record.put_row("definitions", variable == side, [form.source])
        return variable
    if row is not None:
        record.put_row("sides", row, [form.source])
    return side


def _parts(record: RelaxationRecord, form: CanonicalForm, side: Any) -> dict[SidePart, Any]:
    """Two variables for the parts of a free side, whatever the option `lift`: no expression is smooth at zero."""
    positive, negative = map(record.put_variable, part_values(side))
    record.put_row("definitions", positive - negative == side, [form.source])
    return {SidePart.POSITIVE: positive, SidePart.NEGATIVE: negative}
