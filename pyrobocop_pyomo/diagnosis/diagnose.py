"""`diagnose`: everything that can be said about a model before it is solved."""

from __future__ import annotations

from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.base.var import Var
from pyomo.core.expr.visitor import identify_variables

from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.phases.structure import sides_of

from .boundaries import boundary_findings, decided_findings
from .degrees import degrees_of_freedom, phases_of
from .dependence import dependence_findings
from .findings import Diagnosis, Finding, Severity, Subject
from .finite import data_findings, rate_findings, row_findings, values_missing
from .linearisation import Linearisation
from .scaling import scaling_advice
from .structure import structural_findings
from .unit_consistency import unit_findings

_ORDER = list(Severity)


def diagnose(model: Any) -> Diagnosis:
    """Look at a model before a solve: structure, numbers at the guess, units and scaling.

    Nothing is solved and nothing is changed. The Jacobian is evaluated row by row with Pyomo's expressions, so that it
    takes about as long as building the model did; `rcp.solve` only asks each phase's `check`.

    Parameters
    ----------
    model : ConcreteModel, Block or PhaseBlock
        Looked at with all its active blocks.

    Returns
    -------
    Diagnosis
        Counts, findings with names and remedies, and factors for scaling.
    """
    phases = phases_of(model)
    remarks: list[str] = []
    findings: list[Finding] = []
    for phase in phases:
        findings += structural_findings(phase)
        findings += rate_findings(phase)
        findings += boundary_findings(phase, remarks)
    reported = {
        f"{name}_{kind}" for each in findings for name in each.components for kind in ("collocation", "equation")
    }
    missing = values_missing(model)
    if missing:
        remarks.append(f"rows that hold a variable without a value: {', '.join(missing)}")
    linearisation = Linearisation(model)
    findings += data_findings(model)
    findings += row_findings(linearisation, reported)
    findings += decided_findings(model)
    findings += _nowhere(model, {name for each in findings for name in each.components})
    findings += dependence_findings(model, linearisation)
    findings += unit_findings(model)
    advice, factors = scaling_advice(linearisation)
    findings += advice
    degrees = [degrees_of_freedom(phase) for phase in phases]
    if len(phases) != 1 or phases[0] is not model:
        degrees.append(degrees_of_freedom(model))
    findings.sort(key=lambda each: _ORDER.index(each.severity))
    return Diagnosis(model.name, tuple(findings), tuple(degrees), factors, tuple(remarks))


def _nowhere(block: Any, known: set[str]) -> list[Finding]:
    """Variables in no row, pair or objective of the whole model, one finding for all."""
    model = block.model()
    seen: set[int] = set()
    for row in model.component_data_objects(Constraint, active=True, descend_into=Block):
        seen.update(id(v) for v in identify_variables(row.body))
    for objective in model.component_data_objects(Objective, active=True, descend_into=Block):
        seen.update(id(v) for v in identify_variables(objective.expr))
    for pair in model.component_data_objects(PAIR_TYPES, active=True, descend_into=Block):
        seen.update(
            id(v) for side in sides_of(pair) if hasattr(side, "is_expression_type") for v in identify_variables(side)
        )
    lost = [
        data
        for data in block.component_data_objects(Var, active=True, descend_into=Block)
        if id(data) not in seen and not data.fixed and data.parent_component().name not in known
    ]
    if not lost:
        return []
    names = tuple(dict.fromkeys(data.parent_component().name for data in lost))
    return [
        Finding(
            Severity.WARNING,
            Subject.UNDETERMINED,
            f"{len(lost)} variables are in no active row, pair or objective, for example '{lost[0].name}': their "
            "values come back as they are.",
            names,
            "Use them, fix them or remove them.",
        )
    ]
