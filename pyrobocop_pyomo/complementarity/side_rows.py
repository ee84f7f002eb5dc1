"""What keeps the sides of a statement: rows for their signs, variables that stand for them and for their parts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .canonical import CanonicalForm, CanonicalPair, Part
from .generated import component_of, new_parameter, new_variable
from .lifting import part_values, side_variable
from .record import Record, RelaxedPair, RelaxedStatement
from .relaxations.protocol import side_slack


@dataclass(eq=False, slots=True)
class PreparedStatement:
    """A statement with what it needs beyond its products; nothing of it is in a component yet."""

    statement: RelaxedStatement
    home: Any
    sides: list[Any] = field(default_factory=list)
    definitions: list[Any] = field(default_factory=list)
    variables: list[Any] = field(default_factory=list)
    slacks: list[Any] = field(default_factory=list)


def prepare(record: Record, block: Any, home: Any, form: CanonicalForm) -> PreparedStatement:
    """Say what stands for the sides of a statement, and which rows keep them."""
    pairs: list[RelaxedPair] = []
    prepared = PreparedStatement(RelaxedStatement(form, pairs), home)
    prepared.sides.extend(form.rows)
    parts: dict[Part, Any] = {}
    own = record.abilities.keeps_bounds
    for pair in form.pairs:
        relaxed = RelaxedPair(pair, pair.a, pair.b)
        if own:
            relaxed.a_slack = _own_slack(record, block, prepared, pair.a, pair.a_row)
        relaxed.a = _side(record, block, prepared, pair.a, pair.a_row, relaxed.a_slack)
        if pair.b_part is Part.WHOLE:
            if own:
                relaxed.b_slack = _own_slack(record, block, prepared, pair.b, pair.b_row)
            relaxed.b = _side(record, block, prepared, pair.b, pair.b_row, relaxed.b_slack)
        else:
            if not parts:
                parts = _parts(block, prepared, pair)
            relaxed.b = parts[pair.b_part]
        pairs.append(relaxed)
    return prepared


def _side(record: Record, block: Any, prepared: PreparedStatement, side: Any, row: Any, slack: Any) -> Any:
    """Return what stands for one side."""
    if slack is None:
        slack = side_slack(record.relaxation, record.main.delta)
    exact = slack.__class__ in (int, float) and slack == 0
    if record.lift and side_variable(side) is None:
        lower = None if slack is None else 0 if exact else -slack
        variable = new_variable(component_of(block, "lifted"), lower, part_values(side)[0])
        prepared.variables.append(variable)
        prepared.definitions.append(variable == side)
        return variable
    if row is not None and slack is not None:
        prepared.sides.append(row if exact else side >= -slack)
    return side


def _own_slack(record: Record, block: Any, prepared: PreparedStatement, side: Any, row: Any) -> Any:
    """A slack of this side alone, where its sign is kept by something generated and not by the user's own bound."""
    if row is None and not (record.lift and side_variable(side) is None):
        return None
    slack = new_parameter(component_of(block, "states"), record.main.delta.value)
    prepared.slacks.append(slack)
    return slack


def _parts(block: Any, prepared: PreparedStatement, pair: CanonicalPair) -> dict[Part, Any]:
    """Two variables for the parts of a free side, whatever the option `lift`: no expression is smooth at zero.

    The parts keep their signs exactly under every relaxation, since a part below zero would have no meaning.
    """
    component = component_of(block, "lifted")
    positive, negative = (new_variable(component, 0, start) for start in part_values(pair.b))
    prepared.variables += [positive, negative]
    prepared.definitions.append(positive - negative == pair.b)
    return {Part.POSITIVE: positive, Part.NEGATIVE: negative}
