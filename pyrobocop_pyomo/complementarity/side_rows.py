"""What keeps the sides of statements: rows for their signs, variables that stand for them and for their parts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .canonical import CanonicalForm, CanonicalPair, Part
from .generated import GeneratedBlock, is_zero
from .lifting import part_values, side_variable
from .record import RelaxedPair, RelaxedStatement


@dataclass(eq=False, slots=True)
class Preparation:
    """What the statements of one home need beyond their products; nothing of it is in a component yet.

    Rows come with the statement that they belong to. One list serves all statements, since most need nothing.
    """

    place: GeneratedBlock
    pairs: list[RelaxedPair] = field(default_factory=list)
    sides: list[tuple[RelaxedStatement, Any]] = field(default_factory=list)
    definitions: list[tuple[RelaxedStatement, Any]] = field(default_factory=list)
    variables: list[Any] = field(default_factory=list)
    slacks: list[Any] = field(default_factory=list)

    def add(self, form: CanonicalForm) -> RelaxedStatement:
        """Say what stands for the sides of a statement, and which rows keep them."""
        statement = RelaxedStatement(form)
        for row in form.rows:
            self.sides.append((statement, row))
        parts: dict[Part, Any] | None = None
        keeps_bounds = self.place.record.abilities.keeps_bounds
        relaxed_pairs = []
        for pair in form.pairs:
            relaxed = RelaxedPair(pair, pair.a, pair.b)
            if keeps_bounds:
                relaxed.a_slack = self._own_slack(pair.a, pair.a_row)
            relaxed.a = self._side(statement, pair.a, pair.a_row, relaxed.a_slack)
            if pair.b_part is Part.WHOLE:
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
        """Return what stands for one side."""
        place = self.place
        slack, exact = (place.slack, place.exact) if own_slack is None else (own_slack, is_zero(own_slack))
        if place.record.lift and side_variable(side) is None:
            lower = None if slack is None else 0 if exact else -slack
            variable = self._new_variable(statement, lower, part_values(side)[0])
            self.definitions.append((statement, variable == side))
            return variable
        if row is not None and slack is not None:
            self.sides.append((statement, row if exact else side >= -slack))
        return side

    def _own_slack(self, side: Any, row: Any) -> Any:
        """A slack of this side alone, where its sign is kept by something generated and not by the user's own bound."""
        if row is None and not (self.place.record.lift and side_variable(side) is None):
            return None
        slack = self.place.new_state(self.place.record.main.delta.value)
        self.slacks.append(slack)
        return slack

    def _parts(self, statement: RelaxedStatement, pair: CanonicalPair) -> dict[Part, Any]:
        """Two variables for the parts of a free side, whatever the option `lift`: no expression is smooth at zero.

        The parts keep their signs exactly under every relaxation, since a part below zero would have no meaning.
        """
        positive, negative = (self._new_variable(statement, 0, start) for start in part_values(pair.b))
        self.definitions.append((statement, positive - negative == pair.b))
        return {Part.POSITIVE: positive, Part.NEGATIVE: negative}

    def _new_variable(self, statement: RelaxedStatement, lower: Any, start: float) -> Any:
        variable = self.place.new_variable("lifted", lower, start)
        self.variables.append(variable)
        statement.variables += (variable,)
        return variable
