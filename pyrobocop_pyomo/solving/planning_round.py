"""One round of planning around obstacles: what was done, what came out, and how clear of obstacles it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pyrobocop_pyomo.motion import SafetyReport

from .quality import Quality


@dataclass(frozen=True)
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
        By how much the motion comes closer than its clearance, at worst; negative where there is room left.
    worst : str
        The two bodies for which that is so.
    safe : bool
        Whether the clearance is proven for the whole motion.
    seconds : float
        Of the solve.
    """

    purpose: str
    quality: Quality
    objective: float
    iterations: int
    shortfall: float
    worst: str
    safe: bool
    seconds: float

    @classmethod
    def of(cls, purpose: str, result: Any, report: SafetyReport) -> PlanningRound:
        """Put a result and a report together."""
        worst = report.worst
        return cls(
            purpose=purpose,
            quality=result.quality,
            objective=result.objective,
            iterations=result.iterations,
            shortfall=worst.clearance - worst.distance if worst is not None else 0.0,
            worst=f"{worst.first} - {worst.second}" if worst is not None else "",
            safe=report.safe,
            seconds=result.seconds,
        )

    def __str__(self) -> str:
        # What was done takes as much room as it needs, at the end.
        return (
            f"{self.quality.name:<10} {self.objective:>13.6g} {self.iterations:>6} {self.shortfall:>10.2e} "
            f"{'yes' if self.safe else 'no':>5} {self.seconds:>8.2f}  {self.worst:<28} {self.purpose}"
        )


ROUND_HEADER = (
    f"{'quality':<10} {'objective':>13} {'iter':>6} {'shortfall':>10} {'safe':>5} {'seconds':>8}  "
    f"{'worst pair':<28} round"
)
