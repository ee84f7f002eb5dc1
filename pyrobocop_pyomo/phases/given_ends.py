"""The values that are given at the ends of a phase, against what the phase states.

Path constraints and pairs are rows at the collocation points, and most implicit schemes have none where the phase
starts. What is stated holds there all the same: where the values that are given decide it, the rules are evaluated. One
that returns ``Skip`` at that time states nothing there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.expr.relational_expr import EqualityExpression
from pyomo.repn import generate_standard_repn

from pyrobocop_pyomo.complementarity import CanonicalForm, SidePart
from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.modeling.row_violations import bound_violation, number_or_nan, relation_violation
from pyrobocop_pyomo.modeling.rule_results import variables_read
from pyrobocop_pyomo.numerics import Grid

from .declarations import Algebraic, Parameter
from .record import PhaseRecord, Statement
from .rule_formulas import RuleFormulas

# Rows that say something of one instant; those at boundaries exist wherever they are meant.
KINDS = ("residual", "constraint", "complementarity")


@dataclass(frozen=True)
class EndViolation:
    """What the values at an end of a phase violate.

    Attributes
    ----------
    kind : {"residual", "constraint", "complementarity", "bounds"}
    statement : str
        Name of the rule, or of the algebraic whose bounds are violated.
    row : str
        The same with the label of the row, where the rule states several.
    amount : float
        By how much.
    values : dict of name to float
        What decides it.
    """

    kind: str
    statement: str
    row: str
    amount: float
    values: Mapping[str, float]


def values_given(block: Any, record: PhaseRecord, time: float) -> dict[str, float]:
    """The values of the states that are fixed at an end, and of fixed parameters; none, where no state is fixed."""
    states = {name: block.component(name)[time] for name in record.names_of_states}
    states = {name: data for name, data in states.items() if data.fixed}
    given = {**states, **{name: block.component(name) for name in record.names(Parameter)}} if states else {}
    return {name: data.value for name, data in given.items() if data.fixed and data.value is not None}


def end_violations(
    block: Any,
    record: PhaseRecord,
    time: float,
    values: Mapping[str, float],
    statements: Sequence[Statement],
    grids: tuple[Grid, Grid],
    remarks: list[str],
) -> Iterator[EndViolation]:
    """What the values that are given at an end violate, whatever all other variables are.

    Algebraics that equations give from these values alone are known as well.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
    time : float
        Index of the end.
    values : mapping of name to float
        Of states and parameters.
    statements : sequence of Statement
        Those that are evaluated.
    grids : pair of Grid
        The same grid in time indices and in real time.
    remarks : list of str
        Gets those that cannot be asked there.
    """
    statements = [statement for statement in statements if statement.kind in KINDS]
    if not statements:
        return
    formulas = RuleFormulas(block, record, *grids)
    formulas.set_bounds(time)
    for name, number in values.items():
        formulas.at_instant[name].fix(number, skip_validation=True)
    formulas.index.fix(time)
    formulas.clock.fix(float(np.interp(time, grids[0].mesh.boundaries, grids[1].mesh.boundaries)))
    times = {id(formulas.index), id(formulas.clock)}
    names = {id(variable): name for name, variable in formulas.at_instant.items()}
    rows = [*_rows(block, formulas, time, statements, remarks)]
    for name in _determined(formulas.at_instant, record.names(Algebraic), rows):
        variable = formulas.at_instant[name]
        yield EndViolation(
            "bounds", name, name, bound_violation(variable.value, *variable.bounds), {name: variable.value}
        )
    for statement, name, row in rows:
        for relation, violation in relations_of(row):
            variables = variables_read(relation)
            if all(variable.fixed for variable in variables):
                known = {names.get(id(of), of.name): of.value for of in variables if id(of) not in times}
                yield EndViolation(statement.kind, statement.name, name, violation(relation), known)


def _rows(
    block: Any, formulas: RuleFormulas, time: float, statements: Sequence[Statement], remarks: list[str]
) -> Iterator[tuple[Statement, str, Any]]:
    """What the rules state, pairs in canonical form; by name."""
    for statement in statements:
        try:
            rows = formulas.formulas_of(statement, statement.rows)
        except PyRobocopError as error:
            remarks.append(f"'{statement.name}' of phase '{block.name}' at t = {time:g} ({error})")
            continue
        for label, row in rows.items():
            yield statement, statement.name if label is None else f"{statement.name}[{label}]", row


def relations_of(row: Any) -> Iterator[tuple[Any, Callable[[Any], float]]]:
    """What has to hold of a row or a form, and what tells how far it is from that."""
    if not isinstance(row, CanonicalForm):
        yield row, _violation
        return
    yield from ((beside, _violation) for beside in row.rows)
    for pair in row.pairs:
        for side, part in ((pair.a, pair.a_part), (pair.b, pair.b_part)):
            if part is SidePart.WHOLE:
                yield side, _below_zero


def _violation(relation: Any) -> float:
    return relation_violation(relation, unknown=0.0)


def _below_zero(side: Any) -> float:
    return max(0.0, -number_or_nan(side))


def _determined(
    at_instant: Mapping[str, Any], names: Sequence[str], rows: Sequence[tuple[Statement, str, Any]]
) -> Iterator[str]:
    """Algebraics that linear equations give from what is known, one after the other; they are fixed from then on."""
    algebraics = {id(at_instant[name]): name for name in names}
    equations = [row for statement, _, row in rows if statement.kind == "residual"] if algebraics else []
    is_progress = True
    while is_progress:
        is_progress = False
        for row in equations:
            free = [variable for variable in variables_read(row) if not variable.fixed]
            if len(free) != 1 or id(free[0]) not in algebraics:
                continue
            linear = generate_standard_repn(row.args[0] - row.args[1] if isinstance(row, EqualityExpression) else row)
            if linear.is_linear() and linear.linear_vars:
                free[0].fix(-linear.constant / linear.linear_coefs[0], skip_validation=True)
                is_progress = True
                yield algebraics[id(free[0])]
