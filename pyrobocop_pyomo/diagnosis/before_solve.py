"""The part of a diagnosis that `solve` makes each time: cheap, and certain enough to refuse a model or to doubt it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pyrobocop_pyomo.errors import ContradictionError, ModelError
from pyrobocop_pyomo.phases import phases_of

from .determinacy import excess_findings, freedom_findings
from .findings import Finding, Severity, Subject
from .joining import joining_findings
from .linearised_rows import Equations
from .statements import (
    foreign_findings,
    objective_findings,
    scaled_pair_findings,
    unfinished_findings,
    without_objective,
)
from .values import bound_findings, boundary_findings, discretised_start_findings


def shared_findings(model: Any, remarks: list[str], rows_of_each: int | None = None) -> Iterator[Finding]:
    """What both a solve and a diagnosis look at.

    Parameters
    ----------
    model : Block
    remarks : list of str
        Gets what cannot be checked.
    rows_of_each : int, optional
        How many rows of each component are looked at for variables of another model; all by default.
    """
    yield from scaled_pair_findings(model)
    yield from unfinished_findings(model)
    yield from foreign_findings(model, rows_of_each)
    yield from discretised_start_findings(model)
    if not _is_renamed(model):
        for phase in phases_of(model):
            yield from boundary_findings(phase, remarks)
        yield from joining_findings(model)


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
    yield from bound_findings(model)
    # One row tells of most components; a variable that is met elsewhere is refused when the model is compiled.
    yield from shared_findings(model, [], rows_of_each=1)
    if _is_renamed(model):
        return
    yield from objective_findings(model)
    without = without_objective(model)
    if without:
        equations = Equations(model)
        yield from freedom_findings(model, equations, without)
        yield from excess_findings(model, equations, without)


def _is_renamed(model: Any) -> bool:
    """Whether a transformation has renamed variables of phases, as scaling does: the records are of another model."""
    return any(phase.component(name) is None for phase in phases_of(model) for name in phase.record.declarations)


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
