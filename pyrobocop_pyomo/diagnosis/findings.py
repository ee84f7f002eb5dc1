"""The result of a diagnosis: findings with a severity, names and a remedy."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.presentation import Presented, disclosed_text, table


class Severity(Enum):
    """How much a finding matters; the values are what a report shows."""

    ERROR = "error"
    WARNING = "warning"
    ADVICE = "advice"


class Subject(Enum):
    """What a finding is about."""

    STATEMENT = "what was stated"
    INDEX = "structural index"
    UNDETERMINED = "undetermined variables"
    DEPENDENT = "dependent equations"
    CONTRADICTION = "contradicting equations"
    START = "start and end values"
    DATA = "numbers"
    UNITS = "units"
    OUTCOME = "outcome of the solve"
    IDENTIFIABILITY = "what measurements see"


@dataclass(frozen=True)
class Finding(Presented):
    """One thing that is wrong, or could be better.

    Attributes
    ----------
    severity : Severity
    subject : Subject
    message : str
        What was found, with names and numbers.
    components : tuple of str
        Names of the components and equations concerned, as in the model.
    remedy : str
        What to do about it.
    """

    severity: Severity
    subject: Subject
    message: str
    components: tuple[str, ...]
    remedy: str

    def __str__(self) -> str:
        return f"{self.severity.value}, {self.subject.value}: {self.message} {self.remedy}"


def error_about(subject: Subject, message: str, components: Iterable[str], remedy: str) -> Finding:
    """What has to be changed before a solve can succeed."""
    return Finding(Severity.ERROR, subject, message, tuple(dict.fromkeys(components)), remedy)


def warning_about(subject: Subject, message: str, components: Iterable[str], remedy: str) -> Finding:
    """What may be meant."""
    return Finding(Severity.WARNING, subject, message, tuple(dict.fromkeys(components)), remedy)


def quoted(names: Iterable[object], most: int = 4) -> str:
    """Names in quotes, the first of many."""
    shown = list(map(repr, names))
    more = f" and {len(shown) - most} more" if len(shown) > most else ""
    return ", ".join(shown[:most]) + more


@dataclass(frozen=True)
class DegreesOfFreedom(Presented):
    """Counts of a phase or of a whole model.

    Attributes
    ----------
    name : str
    variables, fixed : int
        All variables, and those among them that are fixed.
    equalities, inequalities : int
        Active constraints.
    pairs : int
        Complementarity pairs, relaxed or not.
    controls : int
        Variables of declared controls that are not fixed.
    """

    name: str
    variables: int
    fixed: int
    equalities: int
    inequalities: int
    pairs: int
    controls: int

    @property
    def degrees(self) -> int:
        """Variables that may move, less equalities."""
        return self.variables - self.fixed - self.equalities

    def __str__(self) -> str:
        return (
            f"{self.name}: {self.variables} variables ({self.fixed} fixed), {self.equalities} equalities, "
            f"{self.inequalities} inequalities, {self.pairs} pairs: {self.degrees} degrees of freedom "
            f"({self.controls} in controls)"
        )


@dataclass(frozen=True)
class Diagnosis(Presented):
    """What was found in a model; printing it shows everything.

    Attributes
    ----------
    name : str
        Of the model or the phase.
    findings : tuple of Finding
        The worst first.
    degrees_of_freedom : tuple of DegreesOfFreedom
        One per phase, and the last of everything together.
    remarks : tuple of str
        What could not be checked, and why.
    """

    name: str
    findings: tuple[Finding, ...]
    degrees_of_freedom: tuple[DegreesOfFreedom, ...]
    remarks: tuple[str, ...] = ()

    def about(self, subject: Subject) -> list[Finding]:
        """The findings on one subject."""
        return [finding for finding in self.findings if finding.subject is subject]

    @property
    def errors(self) -> list[Finding]:
        """What has to be changed before a solve can succeed."""
        return [finding for finding in self.findings if finding.severity is Severity.ERROR]

    def raise_for_errors(self) -> None:
        """Raise a `ModelError` with all errors, if there are any.

        Raises
        ------
        ModelError
            When `errors` is not empty.
        """
        if self.errors:
            raise ModelError(f"'{self.name}': " + "\n".join(map(str, self.errors)))

    def _summary(self) -> str:
        return f"'{self.name}': {self._counts()}"

    def _counts(self) -> str:
        errors, others = len(self.errors), len(self.findings) - len(self.errors)
        return f"{errors} error{'s' * (errors != 1)}, {others} other finding{'s' * (others != 1)}"

    def _html_parts(self) -> list[str]:
        rows = [(one.severity.value, one.subject.value, one.message, one.remedy) for one in self.findings]
        found = [table(("severity", "about", "finding", "remedy"), rows)] if rows else []
        return [*found, disclosed_text("as text", str(self))]

    def __str__(self) -> str:
        lines = [
            f"Diagnosis of '{self.name}': {self._counts()}",
            *(f"  {counts}" for counts in self.degrees_of_freedom),
        ]
        for finding in self.findings:
            lines += [
                f"- {finding.severity.value}, {finding.subject.value}: {finding.message}",
                *([f"    {finding.remedy}"] if finding.remedy else []),
            ]
        return "\n".join([*lines, *(f"  not checked: {remark}" for remark in self.remarks)])
