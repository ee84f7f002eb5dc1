"""Sides as variables: which side is one already, the generated variables that stand for others, and their rows."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from pyomo.core.expr import LinearExpression, MonomialTermExpression, SumExpression
from pyomo.core.expr.numvalue import native_numeric_types

from pyrobocop_pyomo.modeling.expressions import is_plain_variable, value_or_none

from .canonical import CanonicalForm, CanonicalPair, SidePart
from .generated import GeneratedBlock, is_zero
from .record import RelaxedPair, RelaxedStatement
from .units import without_units


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
        number = value_or_none(side)
    except (ArithmeticError, ValueError):  # outside of a function's domain
        number = None
    if number is None or isinstance(number, complex) or number != number:
        return 0.0, 0.0
    number = float(number)
    return (number, 0.0) if number > 0 else (0.0, -number)


@dataclass(eq=False, slots=True)
class SideRows:
    """Rows, variables and slacks of the sides of one home's statements; none of them is in a component yet.

    Rows come with their statements. One list serves all statements, since most need nothing.
    """

    place: GeneratedBlock
    pairs: list[RelaxedPair] = field(default_factory=list)
    sides: list[tuple[RelaxedStatement, Any]] = field(default_factory=list)
    definitions: list[tuple[RelaxedStatement, Any]] = field(default_factory=list)
    variables: list[Any] = field(default_factory=list)
    slacks: list[Any] = field(default_factory=list)

    def add(self, form: CanonicalForm) -> RelaxedStatement:
        """Choose the expressions of the sides of a statement, and the rows that keep their signs."""
        statement = RelaxedStatement(form)
        for row in form.rows:
            self.sides.append((statement, row))
        parts: dict[SidePart, Any] | None = None
        keeps_bounds = self.place.record.abilities.keeps_bounds
        relaxed_pairs: list[RelaxedPair] = []
        for pair in form.pairs:
            relaxed = RelaxedPair(pair, pair.a, pair.b)
            if parts is not None and pair.a_part is not SidePart.WHOLE:
                relaxed.a = parts[pair.a_part]
            elif relaxed_pairs and pair.a is relaxed_pairs[0].pair.a:
                relaxed.a, relaxed.a_slack = relaxed_pairs[0].a, relaxed_pairs[0].a_slack
            else:
                if keeps_bounds:
                    relaxed.a_slack = self._own_slack(pair.a, pair.a_row)
                relaxed.a = self._side(statement, pair.a, pair.a_row, relaxed.a_slack)
            if pair.b_part is SidePart.WHOLE:
                if keeps_bounds:
                    relaxed.b_slack = self._own_slack(pair.b, pair.b_row)
                relaxed.b = self._side(statement, pair.b, pair.b_row, relaxed.b_slack)
            else:
                if parts is None:
                    parts = self._parts(statement, pair)
                relaxed.b = parts[pair.b_part]
            relaxed_pairs.append(relaxed)
        statement.pairs = relaxed_pairs
        self.pairs += relaxed_pairs
        return statement

    def _side(self, statement: RelaxedStatement, side: Any, row: Any, own_slack: Any) -> Any:
        """Return the expression of one side in the generated rows."""
        place = self.place
        slack, exact = (place.slack, place.exact) if own_slack is None else (own_slack, is_zero(own_slack))
        if place.record.lift and side_variable(side) is None:
            lower = None if slack is None else 0 if exact else -slack
            variable = self._new_variable(statement, lower, part_values(side)[0])
            self.definitions.append((statement, variable == without_units(side)))
            return variable
        if row is not None and slack is not None:
            self.sides.append((statement, row if exact else without_units(side) >= -slack))
        return side

    def _own_slack(self, side: Any, row: Any) -> Any:
        """A slack of this side alone, where its sign is kept by something generated and not by the user's own bound."""
        if row is None and not (self.place.record.lift and side_variable(side) is None):
            return None
        slack = self.place.new_state(self.place.record.main.delta.value)
        self.slacks.append(slack)
        return slack

    def _parts(self, statement: RelaxedStatement, pair: CanonicalPair) -> dict[SidePart, Any]:
        """Two variables for the parts of a free side, whatever the option `lift`: no expression is smooth at zero.

        The parts keep their signs exactly under every relaxation, since a part below zero would have no meaning.
        """
        positive, negative = (self._new_variable(statement, 0, start) for start in part_values(pair.b))
        self.definitions.append((statement, positive - negative == without_units(pair.b)))
        return {SidePart.POSITIVE: positive, SidePart.NEGATIVE: negative}

    def _new_variable(self, statement: RelaxedStatement, lower: Any, start: float) -> Any:
        variable = self.place.new_variable("lifted", lower, start)
        self.variables.append(variable)
        statement.variables += (variable,)
        return variable
