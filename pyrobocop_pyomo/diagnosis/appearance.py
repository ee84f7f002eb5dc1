"""Variables that nothing decides: in no row at all, or in rows that any value satisfies."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.base.var import Var
from pyomo.core.expr.visitor import identify_variables

from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.phases.structure import sides_of

from .findings import Finding, Severity, Subject


def appearance_findings(block: Any, known: set[str]) -> Iterator[Finding]:
    """Variables in no row, pair or objective, and states whose level is arbitrary; `known` names are left out."""
    seen = _seen(block.model())
    lost = [
        data
        for data in block.component_data_objects(Var, active=True, descend_into=Block)
        if id(data) not in seen and not data.fixed and data.parent_component().name not in known
    ]
    if lost:
        yield Finding(
            Severity.WARNING,
            Subject.UNDETERMINED,
            f"{len(lost)} variables are in no active row, pair or objective, for example '{lost[0].name}': their "
            "values come back as they are.",
            tuple(dict.fromkeys(data.parent_component().name for data in lost)),
            "Use them, fix them or remove them.",
        )
    for phase in phases_of(block):
        yield from (_adrift(phase, name) for name in _states_adrift(phase, seen))


def _seen(model: Any) -> dict[int, set[str]]:
    """The names of the components in which each variable appears, by the variable's id."""
    seen: dict[int, set[str]] = {}

    def note(expression: Any, name: str) -> None:
        for variable in identify_variables(expression, include_fixed=True):
            seen.setdefault(id(variable), set()).add(name)

    for row in model.component_data_objects(Constraint, active=True, descend_into=Block):
        note(row.body, row.parent_component().name)
    for objective in model.component_data_objects(Objective, active=True, descend_into=Block):
        note(objective.expr, objective.name)
    for pair in model.component_data_objects(PAIR_TYPES, active=True, descend_into=Block):
        for side in sides_of(pair):
            if hasattr(side, "is_expression_type"):
                note(side, pair.parent_component().name)
    return seen


def _states_adrift(phase: Any, seen: dict[int, set[str]]) -> Iterator[str]:
    """States that only their own collocation rows hold, nowhere fixed or bounded, and not in their own derivative."""
    for name in phase.record.names_of_states:
        values = list(phase.component(name).values())
        own = {f"{phase.name}.{name}_{kind}" for kind in ("collocation", "continuity")}
        if any(data.fixed or data.lb is not None or data.ub is not None for data in values):
            continue
        ids = {id(data) for data in values}
        rates = phase.record.rates.get(name, {}).values()
        in_own_rate = any(
            id(variable) in ids
            for rate in rates
            if hasattr(rate, "is_expression_type")
            for variable in identify_variables(rate)
        )
        if not in_own_rate and not set().union(*(seen.get(each, set()) for each in ids)) - own:
            yield name


def _adrift(phase: Any, name: str) -> Finding:
    return Finding(
        Severity.WARNING,
        Subject.UNDETERMINED,
        f"phase '{phase.name}': state '{name}' is in no other row and no objective, and no value of it is given: any "
        "constant may be added to it.",
        (f"{phase.name}.{name}",),
        "Give it an initial value, or remove it.",
    )
