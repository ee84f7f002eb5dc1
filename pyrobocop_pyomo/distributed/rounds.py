"""`Round`: one round of a team, in numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.presentation import Presented

ENDINGS = ("strict", "practical", "rounds")


class PlanScore(Protocol):
    """What a combined plan is worth physically. A strict plan is a practical one, too."""

    @property
    def strict(self) -> bool:
        """Whether the plan holds to small tolerances."""
        ...

    @property
    def practical(self) -> bool:
        """Whether the plan would do its work."""
        ...


def is_success(score: PlanScore | None) -> bool:
    """Whether a plan with this score is a success: at least practical."""
    return score is not None and (score.strict or score.practical)


def ends_rounds(score: PlanScore | None, until: str) -> bool:
    """Whether a plan with this score is what the rounds were carried out for: never, where all of them are wanted."""
    return (until == "strict" and score is not None and score.strict) or (until == "practical" and is_success(score))


@dataclass(frozen=True)
class Round(Presented):
    """One round, in numbers.

    Attributes
    ----------
    number : int
        From 0.
    mu : float or None
    disagreement : float array
        Largest distance of an agent's value from what is agreed on, for each `Shared`, in its unit.
    change : float array
        Largest change of what is agreed on since the round before.
    scaled : float array
        Disagreement times the square root of the penalty as given.
    factors : float array
        On the penalties.
    objective : float
        Sum over the agents.
    reports : mapping of agent to (status, iterations, CPU seconds)
        Of those that were asked.
    failures : mapping of agent to text
        Of those without a usable point in this round.
    score : PlanScore or None
        Of the combined plan, where it was asked for.
    bytes_down, bytes_up : int
        Most that one robot received, and sent.
    seconds : float
        Elapsed.
    hub : str or None
    """

    number: int
    mu: float | None
    disagreement: Array
    change: Array
    scaled: Array
    factors: Array
    objective: float
    reports: Mapping[str, tuple[str, int, float]]
    failures: Mapping[str, str]
    score: PlanScore | None
    bytes_down: int
    bytes_up: int
    seconds: float
    hub: str | None = None

    def agrees(self, tolerance: float) -> bool:
        """Whether neither disagreement nor change exceeds a tolerance."""
        return bool(max(self.disagreement.max(initial=0.0), self.change.max(initial=0.0)) <= tolerance)

    @property
    def parallel_cpu_seconds(self) -> float:
        """Of the slowest robot, and of the hub that follows."""
        of_robots = [seconds for name, (_, _, seconds) in self.reports.items() if name != self.hub]
        of_hub = self.reports[self.hub][2] if self.hub is not None and self.hub in self.reports else 0.0
        return max(of_robots, default=0.0) + of_hub

    def _summary(self) -> str:
        return (
            f"{self.number}: objective {self.objective:.6g}, {len(self.reports)} reports, {len(self.failures)} failures"
        )
