"""What a result and a diagnosis of its model say of a failure, together."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from typing import Any

from pyrobocop_pyomo.diagnosis import Diagnosis, Finding, Severity, Subject, diagnose

from .violations import Violation


class ModelReference:
    """The model of a result, as long as somebody else keeps it; a pickle or a copy holds none.

    Parameters
    ----------
    model : Block or None
    """

    def __init__(self, model: Any = None) -> None:
        self._reference = None if model is None else weakref.ref(model)

    def __call__(self) -> Any:
        """The model; None where it is gone."""
        return None if self._reference is None else self._reference()

    def __reduce__(self) -> Any:
        return ModelReference, ()


def findings_of_outcome(
    name: str, verdict: str, solved: bool, violations: Sequence[Violation], remarks: Sequence[str], model: Any
) -> Diagnosis:
    """A diagnosis of the model, and before it what the solve itself has found.

    Parameters
    ----------
    name : str
        Of the model.
    verdict : str
        What ended the solve, and how good its point is.
    solved : bool
    violations : sequence of Violation
    remarks : sequence of str
        Of the result.
    model : Block or None
        None where it is gone: then only what the result holds is told.
    """
    known = None if model is None else diagnose(model)
    of_model = () if known is None else known.findings
    said = {f"{finding.message} {finding.remedy}" for finding in of_model}
    own = [] if solved else [_outcome(Severity.ERROR, verdict, ())]
    own += [
        _outcome(Severity.ERROR, f"not met: {violation}.", (violation.name,), "Relax it, or what drives it there.")
        for violation in violations
    ]
    own += [_outcome(Severity.ADVICE, remark, ()) for remark in remarks if remark not in said]
    findings = sorted([*own, *of_model], key=lambda finding: list(Severity).index(finding.severity))
    if known is None:
        return Diagnosis(name, tuple(findings), (), {}, ("the model, which no longer exists",))
    return Diagnosis(name, tuple(findings), known.degrees_of_freedom, known.scaling_factors, known.remarks)


def _outcome(severity: Severity, message: str, components: tuple[str, ...], remedy: str = "") -> Finding:
    return Finding(severity, Subject.OUTCOME, message, components, remedy)
