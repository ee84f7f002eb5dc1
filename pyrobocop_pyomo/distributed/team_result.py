"""What planning as a team gave: the combined plan, its physical score, and the rounds.

`Checkpoint`: all that a team needs to go on later, in a file of arrays and JSON. Nothing in it is unpickled.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import SolveFailed, TeamError, TrajectoryError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.presentation import Presented
from pyrobocop_pyomo.trajectories.trajectory import read_archive, write_archive

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
        The results of the closing steps; the plans come from the last one where it is the best.
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
        shortcomings = []
        if self.physics is None and not self.agreement:
            shortcomings.append("the agents do not agree within the tolerance")
        if self.physics is not None and not is_success(self.score):
            shortcomings.append("no plan was scored" if self.score is None else "the plan is not practical by physics")
        rule, least = self.keep_apart, self.least_distance
        if rule is not None and least is not None and not least >= TOO_NEAR * rule.distance:
            known = "it is not known how near robots come" if np.isnan(least) else f"robots come within {least:.3g} m"
            shortcomings.append(f"{known}, and are to keep {rule.distance:g} m apart")
        return shortcomings

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


# ---------------------------------------------------------------------------------------------------------- checkpoints


@dataclass(frozen=True)
class Checkpoint:
    """A team between two rounds.

    Attributes
    ----------
    round : int
        How many rounds were done.
    fingerprint : str
        Of what the team was made of: `fingerprint` of its specs.
    states : mapping of agent's name to (mapping of name to array)
        As `Engine.states` gives them.
    coordinator : mapping of name to array
        What the coordinator has to know.
    """

    round: int
    fingerprint: str
    states: Mapping[str, Mapping[str, np.ndarray]]
    coordinator: Mapping[str, np.ndarray] = field(default_factory=dict)

    def save(self, path: str | Path) -> Path:
        """Write it, at once or not at all: whoever reads meanwhile finds the file before or this one.

        Parameters
        ----------
        path : str or Path
            The suffix ``.npz`` is added where it is missing.

        Returns
        -------
        Path
            The file written.

        Raises
        ------
        TeamError
            When something in it is no array of numbers or texts.
        """
        groups = {f"agent{i}": dict(state) for i, state in enumerate(self.states.values())}
        groups["coordinator"] = dict(self.coordinator)
        for where, group in zip([*self.states, "coordinator"], groups.values(), strict=True):
            for name, values in group.items():
                if np.asarray(values).dtype.hasobject:
                    raise TeamError(f"{path}: '{name}' of '{where}' is no array of numbers; it cannot be saved.")
        facts = {"round": int(self.round), "fingerprint": self.fingerprint, "agents": list(self.states)}
        return write_archive(path, facts, groups)

    @classmethod
    def load(cls, path: str | Path, fingerprint: str | None = None) -> Checkpoint:
        """Read it.

        Parameters
        ----------
        path : str or Path
        fingerprint : str, optional
            Of the team that is to go on.

        Returns
        -------
        Checkpoint

        Raises
        ------
        TeamError
            When the file is not there, is damaged or holds something else, or belongs to another team.
        """
        try:
            facts, groups = read_archive(path)
            states = {name: groups[f"agent{i}"] for i, name in enumerate(facts["agents"])}
            checkpoint = cls(int(facts["round"]), str(facts["fingerprint"]), states, groups["coordinator"])
        except (TrajectoryError, KeyError, TypeError, ValueError) as error:
            raise TeamError(f"{path}: no checkpoint can be read from it ({error.__cause__ or error!r}).") from error
        if fingerprint is not None and checkpoint.fingerprint != fingerprint:
            raise TeamError(
                f"{path}: written by another team (fingerprint {checkpoint.fingerprint[:12]}, this one has "
                f"{fingerprint[:12]}; its agents are {', '.join(checkpoint.states)}). Builders, data, shared "
                "quantities and options have to be the same. To start anew, take another file or delete this one."
            )
        return checkpoint
