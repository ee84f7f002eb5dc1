"""The part of a diagnosis that `solve` makes each time: cheap, and certain enough to refuse a model or to doubt it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pyrobocop_pyomo.errors import ContradictionError, ModelError

from .findings import Finding, Severity, Subject
from .statements import foreign_findings


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
    # One row tells of most components; a variable that is met elsewhere is refused when the model is compiled.
    yield from foreign_findings(model, rows_of_each=1)


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
        raise (ContradictionError if contradiction else ModelError)(f"'{model.name}': {said}")
    return tuple(finding for finding in findings if finding.severity is Severity.WARNING)
