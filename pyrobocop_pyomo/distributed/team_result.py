"""What planning as a team gave: the combined plan, its physical score, and the rounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import SolveFailed
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.presentation import Presented

from .agents import TOO_NEAR, KeepApart
from .closing import ClosedPlan
from .coordination import Plans
from .rounds import PlanScore, Round, is_success


@dataclass(frozen=True)
class TeamResult(Presented):
    """The plan of a team.

    Success is the physical score of the combined plan, and never a status of a solver. Where a team has no physics, it
    is agreement to the tolerance. Where robots are to keep apart, they do so in the plans.

    Attributes
    ----------
    plans : mapping of agent to (mapping of component to float array)
        The best plan: by its score, else the last. Without physics all variables are in it.
    values : mapping of agent to float array
        Shared values of the last round.
    agreed : mapping of component to float array
        What the team agreed on in the last round, or in the closing step that the plans are from.
    rounds : sequence of Round
    score : PlanScore or None
    agreement : bool
        Whether disagreement and change of the last round were within the tolerance, or the plans are from a closing
        step whose rows hold.
    shared : tuple of str
        Names of the shared groups, in the order of ``Round.disagreement``.
    frozen : mapping of agent to text
        Agents that stood still from some round on, and why.
    deaths : mapping of agent to int
        How often a worker was lost.
    objective : float
        Sum of the agents' objectives for the plans.
    closings : sequence of ClosedPlan
        What the closing steps gave; the plans are those of the last one where it is the best.
    physics : object or None
        What scored the plans.
    keep_apart : KeepApart or None
    least_distance : float or None
        Of two robots in the plans, where they are to keep apart; NaN where a robot has no plan.
    """

    plans: Plans
    values: Mapping[str, Array]
    agreed: Mapping[str, Array]
    rounds: Sequence[Round]
    score: PlanScore | None
    agreement: bool
    shared: tuple[str, ...]
    frozen: Mapping[str, str]
    deaths: Mapping[str, int]
    objective: float
    closings: Sequence[ClosedPlan] = ()
    physics: Any = None
    keep_apart: KeepApart | None = None
    least_distance: float | None = None

    @property
    def success(self) -> bool:
        """Whether the plan is at least practical by physics; without physics, whether the agents agree.

        In either case robots that are to keep apart do so.
        """
        return not self._shortcomings()

    def _shortcomings(self) -> list[str]:
        found = []
        if self.physics is None and not self.agreement:
            found.append("the agents do not agree within the tolerance")
        if self.physics is not None and not is_success(self.score):
            found.append("no plan was scored" if self.score is None else "the plan is not practical by physics")
        rule, least = self.keep_apart, self.least_distance
        if rule is not None and least is not None and not least >= TOO_NEAR * rule.distance:
            known = "it is not known how near robots come" if np.isnan(least) else f"robots come within {least:.3g} m"
            found.append(f"{known}, and are to keep {rule.distance:g} m apart")
        return found

    @property
    def iterations(self) -> float:
        """Mean number of Ipopt's iterations in a local solve."""
        counts = [count for record in self.rounds for _, count, _ in record.reports.values()]
        return float(np.mean(counts)) if counts else 0.0

    @property
    def cpu_seconds(self) -> float:
        """Of all local solves and closing steps."""
        of_rounds = sum(seconds for record in self.rounds for _, _, seconds in record.reports.values())
        return of_rounds + sum(closed.cpu_seconds for closed in self.closings)

    def raise_for_failure(self) -> None:
        """Raise unless the plan is a success.

        Raises
        ------
        SolveFailed
            With the score, or the disagreement.
        """
        if not self.success:
            raise SolveFailed(f"the team found no plan that holds.\n{self}", self)

    def __str__(self) -> str:
        last = self.rounds[-1]
        apart = ", ".join(
            f"{name}: {gap:.3g} ({moved:.3g})"
            for name, gap, moved in zip(self.shared, last.disagreement, last.change, strict=True)
        )
        wrong = self._shortcomings()
        verdict = f"NO PLAN THAT HOLDS: {'; '.join(wrong)}" if wrong else "a plan that holds"
        solves = sum(len(record.reports) for record in self.rounds)
        failures = sum(len(record.failures) for record in self.rounds)
        lines = [
            f"{verdict}. {len(self.rounds)} rounds, objective {self.objective:.6g}",
            f"{solves} local solves ({failures} without a usable point), {self.iterations:.1f} iterations each, "
            f"{self.cpu_seconds:.1f} CPU s",
            f"disagreement (change) in the last round: {apart}",
        ]
        lines += [
            f"closing step: {closed.iterations} iterations, {closed.cpu_seconds:.1f} CPU s" for closed in self.closings
        ]
        if wrong:
            lines.append("Give more rounds, or plan for all in one model: rcp.solve(team.central().model).")
        lines += [f"'{name}' was frozen: {reason}" for name, reason in self.frozen.items()]
        if self.score is not None:
            lines.append(str(self.score))
        return "\n".join(lines)
