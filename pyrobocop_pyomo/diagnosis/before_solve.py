"""The part of a diagnosis that `solve` makes each time: cheap, and certain enough to refuse a model or to doubt it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pyrobocop_pyomo.errors import ContradictionError, ModelError
from pyrobocop_pyomo.phases import phases_of

from .determinacy import excess_findings, freedom_findings
from .findings import Finding, Severity, Subject
from .joining import joining_findings
from .statements import foreign_findings, objective_findings, scaled_pair_findings
from .unfinished import unfinished_findings
from .values import bound_findings, boundary_findings, discretised_start_findings


def findings_before_solve(model: Any) -> Iterator[Finding]:
    """What is wrong with a model, by checks whose costs are small beside those of a solve.

    Parameters
    ----------
    model : Block

    Yields
    ------
    Finding
        An error where the model has no solution or cannot mean what it says; a warning where it may be meant.
    """
    yield from scaled_pair_findings(model)
    yield from unfinished_findings(model)
    # One row tells of most components; a variable that is met elsewhere is refused when the model is compiled.
    yield from foreign_findings(model, rows_of_each=1)
    yield from bound_findings(model)
    yield from discretised_start_findings(model)
    phases = phases_of(model)
    if any(phase.component(name) is None for phase in phases for name in phase.record.declarations):
        return  # a transformation has renamed the variables, as scaling does: the records are about another model
    for phase in phases:
        yield from boundary_findings(phase, [])
    yield from objective_findings(model)
    yield from joining_findings(model)
    yield from freedom_findings(model)
    yield from excess_findings(model)


def doubts_before_solve(model: Any) -> tuple[Finding, ...]:
    """Refuse a model that has no solution or cannot mean what it says; give what is doubtful about another one.

    Parameters
    ----------
    model : Block

    Returns
    -------
    tuple of Finding
        For the first lines of the result.

    Raises
    ------
    ContradictionError
        When values that are given contradict what is stated.
    ModelError
        When the model says something that nothing is done with.
    """
    findings = list(findings_before_solve(model))
    errors = [finding for finding in findings if finding.severity is Severity.ERROR]
    if errors:
        said = " ".join(f"{finding.message} {finding.remedy}" for finding in errors)
        contradiction = all(finding.subject in (Subject.CONTRADICTION, Subject.START) for finding in errors)
        if contradiction:
            raise ContradictionError(f"'{model.name}' has no solution. {said}")
        raise ModelError(f"'{model.name}': {said}")
    return tuple(finding for finding in findings if finding.severity is Severity.WARNING)
