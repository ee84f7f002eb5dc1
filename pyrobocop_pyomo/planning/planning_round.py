"""One round of planning around obstacles: what was done, what came out, and how safe it is."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

from pyrobocop_pyomo.motion import SafetyReport
from pyrobocop_pyomo.solving.iterates import Quality
from pyrobocop_pyomo.solving.solve_result import SolveResult


@dataclass(frozen=True, eq=False)
class PlanningRound:
    """One solve with the verification of the motion that came out.

    Attributes
    ----------
    purpose : str
        What was changed before it.
    quality : Quality
    objective : float
    iterations : int
        Of Ipopt, in all steps of the solve.
    shortfall : float
        By how much the motion comes closer than its clearance, at worst, that of the equations included; negative where
        there is room left.
    worst : str
        The two bodies for which that is so.
    safe : bool or None
        As `SafetyReport.safe`; False as well where nobody looked.
    seconds : float
        Of the solve.
    """

    purpose: str
    quality: Quality
    objective: float
    iterations: int
    shortfall: float
    worst: str
    safe: bool | None
    seconds: float

    HEADER: ClassVar[str] = (
        f"{'quality':<10} {'objective':>13} {'iter':>6} {'shortfall':>10} {'safe':>5} {'seconds':>8}  "
        f"{'worst pair':<28} round"
    )

    @classmethod
    def of(cls, purpose: str, result: SolveResult) -> PlanningRound:
        """The round that ended with a result, which was verified unless it has no report."""
        report = result.safety
        worst = None if report is None else report.worst
        return cls(
            purpose,
            result.quality,
            result.objective,
            result.iterations,
            0.0 if worst is None else worst.shortfall,
            "" if worst is None else f"{worst.first} - {worst.second}",
            False if report is None else report.safe,
            result.seconds,
        )

    def __str__(self) -> str:
        # What was done takes as much room as it needs, at the end.
        safe = "clear" if self.safe is None else "yes" if self.safe else "no"
        return (
            f"{self.quality.name:<10} {self.objective:>13.6g} {self.iterations:>6} {self.shortfall:>10.2e} "
            f"{safe:>5} {self.seconds:>8.2f}  {self.worst:<28} {self.purpose}"
        )


def with_safety(result: SolveResult, report: SafetyReport | None) -> SolveResult:
    """A result with the report on its motion, if any, and what the motion lacks in its standing."""
    safe, worst = (False, None) if report is None else (report.safe, report.worst)
    # A motion that is not proven stands behind every one that is, also where no instant of it is too close, and one
    # that is clear but not replayed behind those that are.
    unproven = max(worst.shortfall, worst.tolerance) if worst is not None and safe is False else 0.0
    lacking = math.ulp(0.0) if safe is None else unproven
    return replace(result, safety=report, standing=replace(result.standing, shortfall=lacking))


def is_settled(result: SolveResult) -> bool:
    """Whether it is a plan to go by, as far as can be known."""
    return result.safety is not None and result.was_safe is not False


def is_near(report: SafetyReport | None) -> bool:
    """Whether a motion is too close by its clearance at most: what margins or a finer mesh make safe.

    What was not verified is taken to be: a plan on a finer mesh starts from there.
    """
    return report is None or (report.worst is not None and report.worst.shortfall <= report.worst.clearance)
