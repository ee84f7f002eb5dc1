"""The result of a diagnosis: findings with a severity, names and a remedy."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.presentation import Presented


class Severity(Enum):
    """How much a finding matters; the values are what a report shows."""

    ERROR = "error"
    WARNING = "warning"
    ADVICE = "advice"


@dataclass(frozen=True)
class Finding(Presented):
    """One thing that is wrong, or could be better.

    Attributes
    ----------
    severity : Severity
    message : str
        What was found, with names and numbers.
    components : tuple of str
        Names of the components and equations concerned, as in the model.
    remedy : str
        What to do about it.
    """

    severity: Severity
    message: str
    components: tuple[str, ...]
    remedy: str

    def __str__(self) -> str:
        return f"{self.severity.value}: {self.message} {self.remedy}"


def error_about(message: str, components: Iterable[str], remedy: str) -> Finding:
    """What has to be changed before a solve can succeed."""
    return Finding(Severity.ERROR, message, tuple(dict.fromkeys(components)), remedy)


def warning_about(message: str, components: Iterable[str], remedy: str) -> Finding:
    """What may be meant."""
    return Finding(Severity.WARNING, message, tuple(dict.fromkeys(components)), remedy)


def quoted(names: Iterable[object], most: int = 4) -> str:
    """Names in quotes, the first of many."""
    shown = list(map(repr, names))
    more = f" and {len(shown) - most} more" if len(shown) > most else ""
    return ", ".join(shown[:most]) + more


@dataclass(frozen=True)
class Diagnosis(Presented):
    """What was found in a model; printing it shows everything.

    Attributes
    ----------
    name : str
        Of the model or the phase.
    findings : tuple of Finding
        The worst first.
    counts : tuple of str
        Variables, rows and pairs of each phase, and the last of everything together.
    remarks : tuple of str
        What could not be checked, and why.
    """

    name: str
    findings: tuple[Finding, ...]
    counts: tuple[str, ...]
    remarks: tuple[str, ...] = ()

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

    def __str__(self) -> str:
        errors, others = len(self.errors), len(self.findings) - len(self.errors)
        counts = f"{errors} error{'s' * (errors != 1)}, {others} other finding{'s' * (others != 1)}"
        lines = [f"Diagnosis of '{self.name}': {counts}", *(f"  {each}" for each in self.counts)]
        for finding in self.findings:
            lines += [
                f"- {finding.severity.value}: {finding.message}",
                *([f"    {finding.remedy}"] if finding.remedy else []),
            ]
        return "\n".join([*lines, *(f"  not checked: {remark}" for remark in self.remarks)])
