"""`Team`: agents that plan together, and the ways to solve for their plan."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import TeamError
from pyrobocop_pyomo.execution.engine import Engine
from pyrobocop_pyomo.execution.engines import find_engine
from pyrobocop_pyomo.execution.tasks import fingerprint
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.presentation.progress import Progress

from .agents import Agent, KeepApart, Shared
from .closing import ClosedPlan
from .coordination import Coordination, Physics, Plans, TeamState
from .local_problem import ProblemSpec
from .merging import MergedModel, merge_agents, variables_behind
from .method import Hub, Method, Sova
from .rounds import PlanScore, Round, ends_rounds, is_success
from .team_result import Checkpoint, TeamResult

logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Team:
    """Agents with models of their own, and their shared quantities.

    Parameters
    ----------
    robots : sequence of Agent
    shared : sequence of Shared
    hub : Agent, optional
        The agent in the middle: the object that the robots move, with its dynamics and the wrenches of all.
    keep_apart : KeepApart, optional
    physics : callable, optional
        Scores a combined plan by physics, such as ``rcp.mechanics.planar.PlanScore``.

    Raises
    ------
    TeamError
        When names are double, or nothing is shared.

    Notes
    -----
    A `Shared` names components as the agents' own models do. What one robot shares with the hub alone
    is named with ``{robot}``.

    References
    ----------
    Shorinwa, Devlin, Hawkes & Schwager, DisCo: Distributed Contact-Rich Trajectory Optimization for Forceful
    Multi-Robot Collaboration, 2024, doi:10.48550/arXiv.2410.23283
    """

    robots: Sequence[Agent]
    shared: Sequence[Shared]
    hub: Agent | None = None
    keep_apart: KeepApart | None = None
    physics: Physics | None = None

    def __post_init__(self) -> None:
        """Refuse what makes no team."""
        object.__setattr__(self, "robots", tuple(self.robots))
        object.__setattr__(self, "shared", tuple(self.shared))
        if not self.robots:
            raise TeamError("a team needs robots; none were given.")
        agents = [*self.robots, *([self.hub] if self.hub is not None else [])]
        for agent in agents:
            if not isinstance(agent, Agent):
                raise TeamError(f"{agent!r} is no Agent. Write Agent(name, builder, *data).")
        names = [agent.name for agent in agents]
        for name in names:
            if names.count(name) > 1:
                raise TeamError(f"{names.count(name)} agents have the name '{name}'. Give each a name of its own.")
        if not self.shared:
            raise TeamError(
                "the agents of a team share something: give shared=[Shared(...)]. Robots that only keep out of each "
                "other's way need no team: give each a phase of one model, and the model an ObstacleAvoidanceBlock."
            )
        if self.hub is None and any(shared.of_one_robot for shared in self.shared):
            raise TeamError("what is named with {robot} is shared with a hub; this team has none. Give hub=Agent(...).")

    @property
    def names(self) -> list[str]:
        """Of the robots."""
        return [robot.name for robot in self.robots]

    def without(self, *robots: str) -> Team:
        """Make the team without some of its robots.

        Parameters
        ----------
        *robots : str
            Names of the robots that have left.

        Returns
        -------
        Team
            What a robot that left shared with the hub alone, such as its force, is held at zero in the model of the
            hub; nobody keeps a distance from it.

        Raises
        ------
        TeamError
            For an unknown robot, or when nobody would be left.
        """
        for name in robots:
            if name not in self.names:
                raise TeamError(f"no robot '{name}' is in the team; there are {', '.join(self.names)}.")
        left = [robot for robot in self.robots if robot.name not in robots]
        hub = self.hub
        if hub is not None:
            of_one = [shared for shared in self.shared if shared.of_one_robot]
            zero = tuple(component for shared in of_one for name in robots for component in shared.names_for(name))
            hub = Agent(hub.name, _built_with_zeros, hub, zero)
        return replace(self, robots=left, hub=hub)

    def keeps_apart(self, plans: Plans) -> bool:
        """Whether no two robots are too near in their plans."""
        return self.keep_apart is None or self.keep_apart.holds(plans, self.names)

    def worth(self, score: PlanScore | None, plans: Plans) -> tuple[bool, bool, bool]:
        """What a plan with its score is worth; the larger, the better."""
        success = is_success(score)
        return success and self.keeps_apart(plans), score is not None and score.strict, success

    # ---------------------------------------------------------------- problems

    def problem_specs(self, method: Method | str = "hub") -> list[ProblemSpec]:
        """How each agent's problem is built for a method.

        Parameters
        ----------
        method : "hub", "sova" or a method
        """
        method = find_method(method, self)
        rule, neighbours = self.keep_apart, 0
        if rule is not None and method.closing is None:  # a closing step keeps robots apart by itself
            neighbours = min(rule.neighbours, len(self.robots) - 1)
        of_robots, of_hub = self._components_of_plans()
        if self.hub is not None and method.has_hub:
            specs = [ProblemSpec(self.hub.name, (self.hub,), self._shared_by(self.names), plan=of_hub)]
            parts = [((robot,), self._shared_by([robot.name]), of_robots) for robot in self.robots]
        else:  # every robot plans for the hub as well, with what all others do
            hub, specs = () if self.hub is None else (self.hub,), []
            parts = [((*hub, robot), self._shared_by(self.names), (*of_robots, *of_hub)) for robot in self.robots]
        for robot, (agents, shared, plan) in zip(self.robots, parts, strict=True):
            specs.append(ProblemSpec(robot.name, agents, shared, rule, neighbours, plan))
        return specs

    def _components_of_plans(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """What the plans of robots and of the hub have: what physics reads, and positions."""
        positions = () if self.keep_apart is None else self.keep_apart.components
        if self.physics is None:
            return positions, ()
        return (*self.physics.robot_components, *positions), tuple(self.physics.hub_components)

    def _shared_by(self, robots: Sequence[str]) -> tuple[tuple[int, Shared, tuple[str, ...]], ...]:
        entries = []
        for number, shared in enumerate(self.shared):
            for robot in robots if shared.of_one_robot else robots[:1]:
                entries.append((number, shared, shared.names_for(robot)))
        return tuple(entries)

    def central(self, *, keep_apart: bool = True) -> MergedModel:
        """One model of the whole team, from the same builders: what a single planner that knows everything solves.

        Parameters
        ----------
        keep_apart : bool
            Whether the model has the distances of `keep_apart`.

        Returns
        -------
        MergedModel
            ``merged.model`` can be given to `solve`; ``merged.parts[agent]`` is an agent's part of it. The distances of
            `keep_apart` are constraints between the robots' unknowns.
        """
        agents = [*([self.hub] if self.hub is not None else []), *self.robots]
        merged = merge_agents(agents, [name for _, _, names in self._shared_by(self.names) for name in names])
        if keep_apart and self.keep_apart is not None and len(self.robots) > 1:
            self.keep_apart.constrain(merged.model, [merged.parts[name] for name in self.names])
        return merged

    def plans_of(self, merged: MergedModel) -> dict[str, dict[str, Array]]:
        """Read the plans of all agents from a model of `central`: what the physics reads; without one, everything."""
        if self.physics is None:
            return merged.all_values()
        of_robots, of_hub = self._components_of_plans()
        plans = {name: merged.values_of(of_robots, name) for name in self.names}
        if self.hub is not None:
            plans[self.hub.name] = merged.values_of(of_hub, self.hub.name)
        return plans

    # ---------------------------------------------------------------- solving

    def solve(
        self,
        method: Method | str = "hub",
        *,
        engine: str | Engine = "serial",
        checkpoint: str | Path | None = None,
        progress: bool | None = None,
        on_round: Any = None,
    ) -> TeamResult:
        """Plan together.

        Parameters
        ----------
        method : "hub", "sova", or a method such as ``Hub(rounds=40)``
            "hub" is the default where the team has one, otherwise "sova".
        engine : str or Engine
            Where the agents live: ``"serial"``, ``"process"``, ``"dask"``, ``"mpi"``. The iterates are the same on all.
        checkpoint : path, optional
            A file that is written after every round, and that a later call of the same team goes on from.
        progress : bool, optional
            Show a line for each round; by default on a terminal.
        on_round : callable, optional
            Called with the `Round` after each; ends the rounds by returning False.

        Returns
        -------
        TeamResult
            Also where the rounds ran out, or after Ctrl-C, with the best plan.

        Raises
        ------
        TeamError
            When the models do not fit together; before any solve.
        EngineError
            When the engine is not installed, or a builder cannot be sent to it.
        """
        method = find_method(method, self)
        mark = "" if checkpoint is None else fingerprint([*self.problem_specs(method), method])
        with find_engine(engine) as running:
            rounds = _Rounds(Coordination(self, method, running), method, Progress(progress), on_round)
            return rounds.run(None if checkpoint is None else Path(checkpoint), mark)


def _built_with_zeros(agent: Agent, components: Sequence[str]) -> Any:
    """Build an agent's model and hold the named quantities at zero."""
    alone = merge_agents([agent], ())
    for name in components:
        for variable in variables_behind(alone.find(name)):
            variable.fix(0.0)
    return alone.model


def find_method(method: Method | str, team: Team) -> Method:
    """Look a method up, and refuse one that does not suit a team.

    Raises
    ------
    TeamError
        For an unknown name, or the hub method without a hub.
    """
    if isinstance(method, str):
        known: dict[str, Callable[[], Method]] = {"hub": Sova if team.hub is None else Hub, "sova": Sova}
        if method not in known:
            raise TeamError(f"method = {method!r}; expected {', '.join(map(repr, known))}, or a method.")
        return known[method]()
    if method.has_hub and team.hub is None:
        raise TeamError("the hub method needs a hub: give hub=Agent(...) to Team, or use Sova.")
    return method


class _Rounds:
    """The rounds of one call of `Team.solve`."""

    def __init__(self, work: Coordination, method: Method, progress: Progress, on_round: Any) -> None:
        self._team, self._method, self._work, self._progress = work.team, method, work, progress
        self._on_round = on_round
        self._closings: list[ClosedPlan] = []
        self._best: ClosedPlan | None = None

    def run(self, path: Path | None, mark: str) -> TeamResult:
        work, method = self._work, self._method
        if path is not None and path.exists():
            state = self._resume(path, mark)
        else:
            state = method.begin(work)
        try:
            done = False
            while not done and state.round < method.rounds:
                record = method.round(work, state)
                self._keep_best(ClosedPlan(dict(work.plans), record.score, record.objective))
                self._progress.live(self._line(record))
                done = self._is_done(record) or self._is_closed(state, record)
                if path is not None:
                    Checkpoint(state.round, mark, work.engine.states(), state.arrays()).save(path)
                if self._on_round is not None and self._on_round(record) is False:
                    done = True
        except KeyboardInterrupt:
            if not work.rounds:
                raise
            logger.warning("round %d was interrupted; the result is that of the rounds before", state.round + 1)
        self._progress.line(self._line(work.rounds[-1]))
        return self._result(state)

    def _is_done(self, record: Round) -> bool:
        method = self._method
        without_physics = self._team.physics is None
        ends = record.agrees(method.tolerance) if without_physics else ends_rounds(record.score, method.until)
        return ends and self._team.keeps_apart(self._work.plans)

    def _is_closed(self, state: TeamState, record: Round) -> bool:
        """Whether one planner could make exact what the agents have nearly agreed on."""
        closing = self._method.closing
        if closing is None or not closing.is_due(record, state.closing_tried):
            return False
        state.closing_tried = record.number
        closed = closing.carry_out(self._team, self._work.all_values(), has_pairs=record.mu is not None)
        self._closings.append(closed)
        self._keep_best(closed)
        is_enough = closed.holds if self._team.physics is None else ends_rounds(closed.score, self._method.until)
        return is_enough and self._team.keeps_apart(closed.plans)

    def _keep_best(self, plan: ClosedPlan) -> None:
        worth, best = self._team.worth, self._best
        # Later plans agree better and are cheaper as a rule.
        is_known = plan.holds if self._team.physics is None else plan.score is not None
        if is_known and (best is None or worth(plan.score, plan.plans) >= worth(best.score, best.plans)):
            self._best = plan

    def _line(self, record: Round) -> str:
        apart = " ".join(f"{gap:.1e}" for gap in record.disagreement)
        counts = " ".join(str(count) for _, count, _ in record.reports.values())
        mu = "" if record.mu is None else f"  mu {record.mu:.0e}"
        failed = f"  {len(record.failures)} failed" if record.failures else ""
        word = ""
        if record.score is not None:
            word = "strict" if record.score.strict else "practical" if record.score.practical else "not physical yet"
        return f"round {record.number + 1}{mu}  apart {apart}  iterations {counts}{failed}  {word}"

    def _result(self, state: TeamState) -> TeamResult:
        work, rule = self._work, self._team.keep_apart
        names = tuple(", ".join(shared.components) for shared in self._team.shared)
        best = self._best
        if best is None:
            plans = work.plans if self._team.physics is not None else work.all_values()
            best = ClosedPlan(dict(plans), None, work.rounds[-1].objective)
        agreement = best.holds or (bool(work.rounds) and work.rounds[-1].agrees(self._method.tolerance))
        source = work.hub or work.robots[0]
        quantities, target = work.facts[source].quantities, work.values_of(source, state.target)
        ends = np.cumsum([len(quantity.keys) for quantity in quantities])[:-1]
        agreed = {of.name: numbers for of, numbers in zip(quantities, np.split(target, ends), strict=True)}
        agreed.update({name: best.plans[source][name] for name in agreed if best.holds and name in best.plans[source]})
        values = {name: work.values_of(name, own) for name, own in zip(work.robots, state.values, strict=True)}
        return TeamResult(
            best.plans, values, agreed, work.rounds, best.score, agreement, names,
            dict(work.frozen), dict(work.engine.deaths), best.objective, self._closings,
            self._team.physics, rule, None if rule is None else rule.least_distance(best.plans, self._team.names),
        )  # fmt: skip

    # ---------------------------------------------------------------- checkpoints

    def _resume(self, path: Path, mark: str) -> TeamState:
        saved = Checkpoint.load(path, mark)
        if saved.round >= self._method.rounds:
            raise TeamError(f"{path}: all {saved.round} rounds are done. Delete the file to start anew.")
        for owner, state in [*saved.states.items(), ("the coordinator", saved.coordinator)]:
            for name, values in state.items():
                if not np.isfinite(values).all():
                    raise TeamError(
                        f"{path}: '{name}' of {owner} has values that are not finite. Delete the file to start anew."
                    )
        self._work.continue_from(saved.states)
        return TeamState.of_arrays(saved.coordinator)
