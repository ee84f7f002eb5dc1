"""The closing step: one planner makes exact what the agents of a team have nearly agreed on."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pyrobocop_pyomo.complementarity import relax
from pyrobocop_pyomo.errors import TeamError
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.planning import solve
from pyrobocop_pyomo.solving.iterates import StopReason, Tolerances
from pyrobocop_pyomo.solving.model_check import ModelCheck
from pyrobocop_pyomo.studies.persistent_nlp import PersistentNLP

from .agents import TOO_NEAR
from .local_problem import DELTA, IPOPT_OPTIONS
from .merging import MergedModel
from .rounds import PlanScore, Round

_NEAR = 1.6  # times the distance to keep: couples of robots that the first problem keeps apart
_DEARER = 0.01


@dataclass(frozen=True)
class Closing:
    """When one planner goes on from the combined plan, with the models of all agents in one.

    Rounds soon find who pushes where and when, and agree to a few per cent. What is left takes them long, since a plan
    is exact only where everybody holds the very same values. A model of all agents has them by construction: its
    barrier problems, started from the combined plan, need few iterations. It takes the agents' models in one place; a
    team whose models have to stay where they are goes without it (``closing=None``).

    Robots are kept apart in pairs that are near each other in the plan; pairs that come near by it are added.

    Attributes
    ----------
    below : float
        It is tried from this mu on; by a team without pairs, which may agree before, after so many rounds as between
        two tries.
    every : int
        Rounds between two tries.
    path : sequence of float
        Barrier parameters, one after the other.
    iterations : int
        Limit of Ipopt's iterations with each.

    Raises
    ------
    TeamError
        For numbers that make no step.
    """

    below: float = 1e-3
    every: int = 12
    path: tuple[float, ...] = (1e-3, 1e-4, 1e-5, 1e-6)
    iterations: int = 200

    def __post_init__(self) -> None:
        """Refuse what makes no step."""
        if not (self.below > 0 and self.every >= 1 and self.iterations >= 1 and self.path and min(self.path) > 0):
            raise TeamError(
                f"{self!r}: expected below > 0, every >= 1, iterations >= 1, and a path of positive numbers."
            )

    def is_due(self, record: Round, tried: int) -> bool:
        """Whether it is tried after a round.

        Parameters
        ----------
        record : Round
        tried : int
            Number of the round after which it was tried last; -1 where it was not.
        """
        if record.mu is None:
            return record.number - max(tried, 0) >= self.every
        return record.mu <= self.below and (tried < 0 or record.number - tried >= self.every)

    def carry_out(self, team: Any, values: Mapping[str, Mapping[str, Array]], *, has_pairs: bool) -> ClosedPlan:
        """Plan for all agents in one model, from their values.

        Parameters
        ----------
        team : Team
        values : mapping of agent to (mapping of component to float array)
            Of all variables in the agents' models.
        has_pairs : bool
            Whether any of these models has pairs.

        Returns
        -------
        ClosedPlan
            The best on the path, whatever it is worth: look at its score and its violation.
        """
        started = time.process_time()
        if has_pairs:
            plan = self._follow(team, values)
        else:
            # What robots agree on without a look at each other may lead to a worse optimum than their own guesses.
            solved = [_solved(team, start) for start in (values, {})]
            plan = max(solved, key=lambda one: (*team.worth(one.score, one.plans), one.holds, -one.objective))
            plan.iterations = sum(one.iterations for one in solved)
        plan.cpu_seconds = time.process_time() - started
        return plan

    def _follow(self, team: Any, values: Mapping[str, Mapping[str, Array]]) -> ClosedPlan:
        """The best plan on the path of barrier parameters, with relaxed pairs."""
        merged = team.central(keep_apart=False)
        merged.put_on(values)
        plan, check = ClosedPlan({}, None, float("nan")), ModelCheck(merged.model)
        _keep_apart(team, merged, _NEAR)
        relax(merged.model, delta=1.0)
        nlp = PersistentNLP(merged.model, IPOPT_OPTIONS, barrier=DELTA, go_on_after_limit=True)
        position, warm = 0, False
        while position < len(self.path):
            mu = self.path[position]
            options = {"tol": max(1e-6, mu), "max_iter": self.iterations}
            outcome = nlp.solve(options, warm=warm, mu=mu, mu_target=mu)
            plan.iterations += outcome.iterations
            plan.status = outcome.status.name
            if outcome.status is IpoptStatus.INTERRUPTED:
                # Ipopt turns Ctrl-C into a status; whoever pressed it wants the rounds to stop.
                raise KeyboardInterrupt
            if not nlp.goes_on_from_last_point:
                break
            plan.take(team, merged, check.violations()[1])
            warm = not _keep_apart(team, merged, TOO_NEAR)
            if warm:
                position += 1
            else:  # the same again, with couples that have come near
                nlp.prepare()
        return plan


@dataclass
class ClosedPlan:
    """What a closing step gave.

    Attributes
    ----------
    plans : mapping of agent to (mapping of component to float array)
    score : PlanScore or None
        None where no point could be used.
    objective : float
        Sum over the agents.
    violation : float
        Largest violation of a row or bound of the agents' models, relative to its size; infinite where no point could
        be used, and without pairs where it is no solution.
    status : str
        Name of the last `IpoptStatus`, without pairs of the `StopReason`.
    iterations : int
        Of Ipopt, in all.
    cpu_seconds : float
        Building the model included.
    """

    plans: Mapping[str, Mapping[str, Array]]
    score: PlanScore | None
    objective: float
    violation: float = float("inf")
    status: str = ""
    iterations: int = 0
    cpu_seconds: float = 0.0

    def take(self, team: Any, merged: MergedModel, violation: float) -> None:
        """Read plan, score and objective from a model with a violation, unless the plan before is better."""
        plans, objective = team.plans_of(merged), merged.objective_value()
        score = None if team.physics is None else team.physics(plans)
        if self.score is not None:
            worth, before = team.worth(score, plans), team.worth(self.score, self.plans)
            # A smaller mu costs a little; where it costs more, Ipopt was on its way.
            if worth < before or (worth == before and objective > self.objective + _DEARER * abs(self.objective)):
                return
        elif self.holds and violation > Tolerances().feasibility:
            return
        self.plans, self.score, self.objective, self.violation = plans, score, objective, violation

    @property
    def holds(self) -> bool:
        """Whether the agents' rows hold, as well as the rows of one model have to."""
        return self.violation <= Tolerances().feasibility


def _solved(team: Any, start: Mapping[str, Mapping[str, Array]]) -> ClosedPlan:
    """The plan of one model of all agents, without pairs, from values or from the agents' own guesses."""
    merged = team.central()
    merged.put_on(start)
    result = solve(merged.model, mesh_tolerance=None, progress=False)
    if result.stop_reason is StopReason.INTERRUPTED:
        raise KeyboardInterrupt  # whoever pressed Ctrl-C wants the rounds to stop
    plan = ClosedPlan({}, None, float("nan"), status=result.stop_reason.name, iterations=result.iterations)
    plan.take(team, merged, ModelCheck(merged.model).violations()[1] if result.solved else float("inf"))
    return plan


def _keep_apart(team: Any, merged: MergedModel, reach: float) -> bool:
    """Keep those apart that are nearer than so many times their distance; whether there are new ones."""
    rule, robots = team.keep_apart, [merged.parts[name] for name in team.names]
    if rule is None or len(robots) < 2 or not rule.constrain(merged.model, robots, reach * rule.distance):
        return False
    # Whoever came near once may do so a little elsewhere next time.
    rule.constrain(merged.model, robots, _NEAR * rule.distance)
    return True
