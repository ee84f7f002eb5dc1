"""The values that are given at the ends of a phase, against what the phase states.

Path constraints and pairs are rows at the collocation points, and most implicit schemes have none where the phase
starts. What is stated holds there all the same: where the values that are given decide it, the rules are evaluated. One
that returns ``Skip`` at that time states nothing there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.repn import generate_standard_repn

from pyrobocop_pyomo.complementarity import CanonicalForm, SidePart
from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.modeling.row_violations import bound_violation, number_or_nan, relation_violation
from pyrobocop_pyomo.modeling.shared_nodes import variables_read

from .declarations import Algebraic, Parameter
from .record import Statement
from .rule_formulas import RuleFormulas
from .step_equations import labelled, zero_of

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


def values_given(block: Any, time: float) -> dict[str, float]:
    """The values of the states that are fixed at an end, and of fixed parameters; none, where no state is fixed."""
    states = {name: block.component(name)[time] for name in block.record.names_of_states}
    states = {name: data for name, data in states.items() if data.fixed}
    given = {**states, **{name: block.component(name) for name in block.record.names(Parameter)}} if states else {}
    return {name: data.value for name, data in given.items() if data.fixed and data.value is not None}


def end_violations(
    formulas: RuleFormulas, time: float, values: Mapping[str, float], statements: list[Statement], remarks: list[str]
) -> Iterator[EndViolation]:
    """What the values that are given at an end violate, whatever all other variables are.

    Algebraics that equations give from these values alone are known as well.

    Parameters
    ----------
    formulas : RuleFormulas
        Used up for everything else: what is known at this end stays fixed in them.
    time : float
        Index of the end.
    values : mapping of name to float
        Of states and parameters.
    statements : list of Statement
        Those that are evaluated.
    remarks : list of str
        Gets those that cannot be evaluated there.
    """
    statements = [statement for statement in statements if statement.kind in KINDS]
    if not statements:
        return
    for name, variable in formulas.at_instant.items():
        if name in values:
            variable.fix(values[name], skip_validation=True)
        else:
            variable.unfix()
    formulas.index.fix(time)
    formulas.clock.fix(float(np.interp(time, formulas.indices.mesh.boundaries, formulas.grid.mesh.boundaries)))
    rows: list[tuple[Statement, str, Any]] = []
    for statement in statements:
        try:
            said = formulas.formulas_of(statement, statement.rows)
            rows += [(statement, labelled(statement.name, label), row) for label, row in said.items()]
        except PyRobocopError as error:
            remarks.append(f"'{statement.name}' of phase '{formulas.block.name}' at t = {time:g} ({error})")
    for name, variable in _determined(formulas, [row for of, _, row in rows if of.kind == "residual"]):
        amount = bound_violation(variable.value, *variable.bounds)
        yield EndViolation("bounds", name, name, amount, {name: variable.value})
    names = {id(variable): name for name, variable in formulas.at_instant.items()}
    times = {id(formulas.index), id(formulas.clock)}
    for statement, name, row in rows:
        for relation, amount in violations_of(row):
            variables = variables_read(relation)
            if all(variable.fixed for variable in variables):
                known = {names.get(id(of), of.name): of.value for of in variables if id(of) not in times}
                yield EndViolation(statement.kind, statement.name, name, amount, known)


def violations_of(row: Any) -> Iterator[tuple[Any, float]]:
    """What has to hold of a row or a form, and how far it is from that at the values of its variables."""
    is_form = isinstance(row, CanonicalForm)
    for relation in row.rows if is_form else [row]:
        yield relation, relation_violation(relation, unknown=0.0)
    for pair in row.pairs if is_form else ():
        for side, part in ((pair.a, pair.a_part), (pair.b, pair.b_part)):
            if part is SidePart.WHOLE:
                yield side, max(0.0, -number_or_nan(side))


def _determined(formulas: RuleFormulas, equations: Sequence[Any]) -> Iterator[tuple[str, Any]]:
    """Algebraics that linear equations give from what is known, one after the other; they are fixed from then on."""
    algebraics = {id(formulas.at_instant[name]): name for name in formulas.record.names(Algebraic)}
    is_progress = bool(algebraics)
    while is_progress:
        is_progress = False
        for row in equations:
            free = [variable for variable in variables_read(row) if not variable.fixed]
            if len(free) != 1 or id(free[0]) not in algebraics:
                continue
            linear = generate_standard_repn(zero_of(row))
            if linear.is_linear() and linear.linear_vars:
                free[0].fix(-linear.constant / linear.linear_coefs[0], skip_validation=True)
                is_progress = True
                yield algebraics[id(free[0])], free[0]
