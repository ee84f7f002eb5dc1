"""What no interior-point method can take: several objectives, discrete variables, pairs without a canonical form."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.objective import Objective
from pyomo.core.base.var import Var

from pyrobocop_pyomo.complementarity import canonical_form
from pyrobocop_pyomo.complementarity.pairs import active_sources
from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.phases import phases_of

from .findings import Finding, Severity, Subject


def statement_findings(block: Any) -> Iterator[Finding]:
    """Statements that are refused, or misread, later on."""
    objectives = [
        each.name for each in block.model().component_data_objects(Objective, active=True, descend_into=Block)
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
                f"phase '{phase.name}' has no state: its instants have nothing to do with each other.",
                (phase.name,),
                "Declare what has a derivative as State.",
            )


def _error(message: str, names: tuple[str, ...], remedy: str) -> Finding:
    return Finding(Severity.ERROR, Subject.STATEMENT, message, names, remedy)
