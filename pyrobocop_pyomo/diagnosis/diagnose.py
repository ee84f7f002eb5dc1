"""`diagnose`: everything that can be said about a model before it is solved."""

from __future__ import annotations

from typing import Any

from pyomo.core.base.block import BlockData

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.phases import phases_of

from .appearance import appearance_findings
from .boundaries import boundary_findings, decided_findings
from .degrees import degrees_of_freedom
from .dependence import dependence_findings
from .findings import Diagnosis, Finding, Severity
from .finite import data_findings, rate_findings, row_findings, values_missing
from .linearisation import Linearisation
from .scaling import scaling_advice
from .statements import statement_findings
from .structure import structural_findings
from .unit_consistency import unit_findings

_ORDER = list(Severity)


def diagnose(model: Any) -> Diagnosis:
    """Look at a model before a solve: structure, numbers at the guess, units and scaling.

    Nothing is solved and nothing is changed. The Jacobian is evaluated row by row with Pyomo's expressions,
    which takes some seconds for ten thousand rows; `rcp.solve` only asks each phase's `check`.

    Parameters
    ----------
    model : ConcreteModel, Block or PhaseBlock
        Looked at with all its active blocks.

    Returns
    -------
    Diagnosis
        Counts, findings with names and remedies, and factors for scaling.

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
    findings: list[Finding] = list(statement_findings(model))
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
    findings += appearance_findings(model, {name for each in findings for name in each.components})
    findings += dependence_findings(model, linearisation)
    findings += unit_findings(model)
    advice, factors = scaling_advice(linearisation, phases)
    findings += advice
    degrees = [degrees_of_freedom(phase) for phase in phases]
    if len(phases) != 1 or phases[0] is not model:
        degrees.append(degrees_of_freedom(model))
    findings.sort(key=lambda each: _ORDER.index(each.severity))
    return Diagnosis(model.name, tuple(findings), tuple(degrees), factors, tuple(remarks))
