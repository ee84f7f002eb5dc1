"""Does a phase make sense? Counts and appearances, checked before any solve."""

from __future__ import annotations

from itertools import islice
from typing import Any

from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.expr.visitor import identify_variables
from pyomo.mpec import Complementarity as PyomoComplementarity

from pyrobocop_pyomo.complementarity import Complementarity
from pyrobocop_pyomo.errors import TranscriptionError

from .controls import refuse_weightless_controls
from .declarations import Algebraic, Control, Parameter
from .record import PhaseRecord
from .structure import check_structure, sides_of


def check_phase(block: Any, record: PhaseRecord) -> None:
    """Raise a `TranscriptionError` that names the culprit when equations and variables do not fit."""
    if any(block.component(name) is None for name in record.declarations):
        return  # a transformation has renamed the variables, as scaling does: the record is about another model
    _check_each_state_has_an_equation(block, record)
    _check_counts(block, record)
    refuse_weightless_controls(block, record)
    _check_each_variable_appears(block, record)
    check_structure(block, record)


def _check_each_state_has_an_equation(block: Any, record: PhaseRecord) -> None:
    for name in record.names_of_states:
        if name not in record.equation_of and name not in record.kept_derivatives:
            where = record.declarations[name].declared_at
            raise TranscriptionError(
                f"phase '{block.name}': state '{name}' (declared at {where}) has no equation. State its derivative in "
                "an ode, or use phase.derivative(...) in a residual; what has no derivative is Algebraic or Control."
            )


def _check_counts(block: Any, record: PhaseRecord) -> None:
    states, algebraics = len(record.names_of_states), len(record.names(Algebraic))
    needed, odes, residuals = states + algebraics, len(record.equation_of), record.residuals_per_point
    # A pair may determine an algebraic, or just restrict the controls; the user's own equality constraints over the
    # points likewise. They count only when something is missing.
    points = len(record.grid.points)
    pairs = sum(_per_point(component, points) for component in _complementarities(block))
    stated = {statement.name for statement in record.statements if statement.kind == "residual"}
    own = sum(
        _per_point(component, points)
        for component in _active_constraints(block)
        if component.local_name not in stated | record.generated_rows
        and any(row.equality for row in component.values())
    )
    counts = (
        f"{states} states and {algebraics} algebraics need {needed} equations per collocation point; stated are {odes} "
        f"in odes, {residuals} in residuals and {pairs} complementarity pairs"
    )
    if odes + residuals > needed:
        raise TranscriptionError(
            f"phase '{block.name}': too many equations. {counts}. Remove an equation, declare what it determines as "
            "Algebraic, or state it as a 'constraint' that restricts the controls."
        )
    if odes + residuals + pairs + own < needed:
        raise TranscriptionError(
            f"phase '{block.name}': too few equations. {counts}. Add an equation, or declare what is free to choose "
            "as Control."
        )


def _complementarities(block: Any) -> list[Any]:
    return [
        component
        for ctype in (Complementarity, PyomoComplementarity)
        for component in block.component_objects(ctype, descend_into=False)
    ]


def _active_constraints(block: Any) -> list[Any]:
    # Not component_objects(active=True): that finds nothing in a phase which is itself deactivated.
    return [component for component in block.component_map(Constraint).values() if component.active]


def _per_point(component: Any, points: int) -> int:
    return -(-len(component) // points)


def _check_each_variable_appears(block: Any, record: PhaseRecord) -> None:
    """A variable in no row and no objective would come back as noise: name it."""
    declared = [name for kind in (Control, Algebraic, Parameter) for name in record.names(kind)]
    missing = {name: {id(data) for data in _variables(block, record, name)} for name in declared}
    for expression in _expressions(block):
        if not missing:
            return
        seen = {id(variable) for variable in identify_variables(expression, include_fixed=True)}
        missing = {name: ids for name, ids in missing.items() if not ids & seen}
    for name in missing:
        declaration = record.declarations[name]
        kind = type(declaration).__name__.lower()
        raise TranscriptionError(
            f"phase '{block.name}': {kind} '{name}' (declared at {declaration.declared_at}) appears in no equation, "
            "constraint or objective. Use it or remove it."
        )


def _variables(block: Any, record: PhaseRecord, name: str) -> Any:
    if isinstance(record.declarations[name], Parameter):
        return [block.component(name)]
    return record.nodes(name).variables(block)


def _expressions(block: Any) -> Any:
    # One row of each of the phase's own components first: nearly always everything is found there.
    own = _active_constraints(block)
    for component in own:
        yield from (row.body for row in islice(component.values(), 1))
    for component in _complementarities(block):
        for data in component.values():
            yield from sides_of(data)
    for component in own:
        for row in component.values():
            yield row.body
    for row in block.model().component_data_objects(Constraint, active=True):
        yield row.body
    for objective in block.model().component_data_objects(Objective, active=True):
        yield objective.expr
