"""`diagnose`: what is wrong with a model, before it is solved."""

from __future__ import annotations

from typing import Any

from pyomo.core.base.block import Block, BlockData
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.var import Var

from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.phases import Control, phases_of

from .determinacy import appearance_findings, dependence_findings, freedom_findings
from .difficult_forms import form_findings
from .findings import DegreesOfFreedom, Diagnosis, Finding, Severity
from .joining import joining_findings
from .linearised_rows import LinearisedRows
from .statements import (
    misplaced_findings,
    objective_findings,
    scaled_pair_findings,
    statement_findings,
    unit_findings,
)
from .structure import structural_findings
from .unfinished import unfinished_findings
from .values import (
    boundary_findings,
    data_findings,
    decided_findings,
    discretised_start_findings,
    rate_findings,
    row_findings,
    values_missing,
)

_ORDER = list(Severity)


def diagnose(model: Any) -> Diagnosis:
    """Look at a model before a solve: structure, numbers at the initial guess, units and scaling.

    Nothing is solved and nothing is changed. The Jacobian is evaluated row by row with Pyomo's expressions,
    which takes some seconds for ten thousand rows; `rcp.solve` makes the cheap part of it each time.

    Parameters
    ----------
    model : ConcreteModel, Block or PhaseBlock
        Looked at with all its active blocks.

    Returns
    -------
    Diagnosis
        Counts, and findings with names and remedies.

    Raises
    ------
    ModelError
        When it is given several blocks at once, or no block.
    """
    if not isinstance(model, BlockData):
        raise ModelError(
            f"'{model}' is no model and no single phase. Diagnose the model, or one phase after the other."
        )
    phases = phases_of(model)
    remarks: list[str] = []
    findings: list[Finding] = [*statement_findings(model), *misplaced_findings(model)]
    findings += [*scaled_pair_findings(model), *unfinished_findings(model)]
    if model is model.model():  # what solves a part of it may have its objective elsewhere
        findings += objective_findings(model)
        findings += freedom_findings(model)
    findings += joining_findings(model)
    findings += form_findings(model)
    for phase in phases:
        findings += structural_findings(phase)
        findings += rate_findings(phase)
        findings += boundary_findings(phase, remarks)
    reported = {
        f"{name}_{kind}" for finding in findings for name in finding.components for kind in ("collocation", "equation")
    }
    missing = values_missing(model)
    if missing:
        remarks.append(f"rows that hold a variable without a value: {', '.join(missing)}")
    linearised = LinearisedRows(model)
    findings += data_findings(model)
    findings += row_findings(linearised, reported)
    findings += decided_findings(model)
    findings += discretised_start_findings(model)
    findings += appearance_findings(model, {name for finding in findings for name in finding.components})
    findings += dependence_findings(model, linearised)
    findings += unit_findings(model)
    degrees = [degrees_of_freedom(phase) for phase in phases]
    if len(phases) != 1 or phases[0] is not model:
        degrees.append(degrees_of_freedom(model))
    findings.sort(key=lambda finding: _ORDER.index(finding.severity))
    return Diagnosis(model.name, tuple(findings), tuple(degrees), tuple(remarks))


def degrees_of_freedom(block: Any) -> DegreesOfFreedom:
    """Count a block with all its active blocks."""
    # By identity: a zero-order hold is the same variable under two names.
    variables = {id(data): data for data in block.component_data_objects(Var, active=True, descend_into=Block)}
    rows = list(block.component_data_objects(Constraint, active=True, descend_into=Block))
    equalities = sum(row.equality for row in rows)
    # Relaxed pairs are deactivated, but still pairs; those on deactivated blocks are not counted.
    pairs = sum(
        len(component)
        for part in block.block_data_objects(active=True, descend_into=Block)
        for ctype in PAIR_TYPES
        for component in part.component_objects(ctype, descend_into=False)
    )
    return DegreesOfFreedom(
        name=block.name,
        variables=len(variables),
        fixed=sum(data.fixed for data in variables.values()),
        equalities=equalities,
        inequalities=len(rows) - equalities,
        pairs=pairs,
        controls=len(_controls(block)),
    )


def _controls(block: Any) -> set[int]:
    return {
        id(data)
        for phase in phases_of(block)
        for name in phase.record.names(Control)
        for data in phase.record.nodes(name).variables(phase)
        if not data.fixed
    }
