"""Statements that are refused or misread later: objectives, discrete variables, pairs, states, and units."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.base.units_container import InconsistentUnitsError, UnitsError
from pyomo.core.base.var import Var
from pyomo.util.check_units import assert_units_consistent

from pyrobocop_pyomo.complementarity import canonical_form
from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES, active_sources
from pyrobocop_pyomo.errors import ComplementarityError, TranscriptionError
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.phases.structure import sides_of

from .findings import Finding, Severity, Subject


def statement_findings(block: Any) -> Iterator[Finding]:
    """Statements that are refused, or misread, later on."""
    objectives = [
        objective.name for objective in block.model().component_data_objects(Objective, active=True, descend_into=Block)
    ]
    if len(objectives) > 1:
        yield _error(
            f"{len(objectives)} objectives are active: {', '.join(map(repr, objectives))}.",
            tuple(objectives),
            "Add them up in one, or deactivate all but one.",
        )
    variables = block.component_data_objects(Var, active=True, descend_into=Block)
    discrete = dict.fromkeys(
        data.parent_component().name for data in variables if not (data.is_continuous() or data.fixed)
    )
    for name in discrete:
        yield _error(
            f"'{name}' is a discrete variable.", (name,), "Ipopt knows real numbers only: fix it, or use a pair."
        )
    wrong: set[str] = set()
    for source in active_sources(block):
        name = source.parent_component().name
        if name in wrong:
            continue
        try:
            canonical_form(source)
        except ComplementarityError as error:
            wrong.add(name)
            yield _error(str(error), (name,), "rcp.solve refuses the model until then.")
    for phase in phases_of(block):
        if not phase.record.names_of_states:
            yield Finding(
                Severity.WARNING,
                Subject.STATEMENT,
                f"phase '{phase.name}' has no state: nothing connects its points in time.",
                (phase.name,),
                "Declare what has a derivative as State.",
            )


def _error(message: str, names: tuple[str, ...], remedy: str) -> Finding:
    return Finding(Severity.ERROR, Subject.STATEMENT, message, names, remedy)


def unit_findings(block: Any) -> Iterator[Finding]:
    """Rows and objectives whose terms have different units, one finding per component; nothing without units."""
    if not any(_has_units(component) for component in block.component_objects(Var, active=True, descend_into=Block)):
        return
    for component in block.component_objects((Constraint, Objective), active=True, descend_into=Block):
        try:
            assert_units_consistent(component)
        except (InconsistentUnitsError, UnitsError) as error:
            yield _finding(component, error)
    for component in block.component_objects(PAIR_TYPES, active=True, descend_into=Block):
        try:
            for data in component.values():
                for side in sides_of(data):
                    assert_units_consistent(side)
        except (InconsistentUnitsError, UnitsError) as error:
            yield _finding(component, error)


def refuse_inconsistent_units(model: Any) -> None:
    """Refuse a phase all of whose variables have units, where the terms of a row differ in them.

    One row of each component is looked at: they come from one rule. Where some variables have no units, units are no
    more than labels, and `unit_findings` says what differs.

    Parameters
    ----------
    model : Block

    Raises
    ------
    TranscriptionError
        Naming the component and the units.
    """
    for phase in phases_of(model):
        declarations = phase.record.declarations.values()
        if not declarations or any(declaration.units is None for declaration in declarations):
            continue
        for component in phase.component_objects(Constraint, active=True, descend_into=False):
            for row in islice(component.values(), 1):
                try:
                    assert_units_consistent(row)
                except (InconsistentUnitsError, UnitsError) as error:
                    finding = _finding(component, error)
                    raise TranscriptionError(f"phase '{phase.name}': {finding.message} {finding.remedy}") from None


def _has_units(component: Any) -> bool:
    return any(data.get_units() is not None for data in component.values())


def _finding(component: Any, error: Exception) -> Finding:
    return Finding(
        Severity.ERROR,
        Subject.UNITS,
        f"'{component.name}': {str(error).strip().rstrip('.')}.",
        (component.name,),
        "Give constants their units (9.81 * units.m / units.s**2), or correct the units of a declaration.",
    )
