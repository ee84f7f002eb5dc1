"""`TeamHorizon`: a team that plans, moves a little, and plans again from where it is, in a few rounds each time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import TeamError
from pyrobocop_pyomo.execution.engine import Engine
from pyrobocop_pyomo.execution.engines import find_engine
from pyrobocop_pyomo.modeling.failures import undone_on_failure
from pyrobocop_pyomo.numerics import Array

from .agents import Shared
from .coordination import Coordination, TeamState
from .method import Method
from .rounds import BarrierPath, Round, is_success
from .team import Team, find_method

Measured = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class PlanningStep:
    """What one step of a team's receding horizon gave.

    Attributes
    ----------
    number : int
        From 0, which is the first plan.
    rounds : sequence of Round
    """

    number: int
    rounds: Sequence[Round]

    @property
    def disagreement(self) -> Array:
        """Largest distance of an agent's value from the agreed value, for each `Shared`, after the last round."""
        return self.rounds[-1].disagreement

    @property
    def failures(self) -> Mapping[str, str]:
        """Agents without a usable point in the last round, and why; they go on with their last plan."""
        return self.rounds[-1].failures


class TeamHorizon:
    """A team whose agents plan again and again while they move: receding horizon, a few rounds for each step.

    In each step the first element of the plan has been carried out. Every agent moves its plan ahead by an
    element, with the multipliers of the agreement, starts where it is measured to be, and goes on warm.
    Use it as a context, or call `stop`.

    Parameters
    ----------
    team : Team
        Its models have phases with a fixed duration and equal elements with one point each; what is measured are the
        states with a fixed initial value.
    method : "hub", "sova" or a method
        Of the first plan.
    engine : str or Engine
    rounds : int
        In each step after the first plan.
    mu : float
        Barrier parameter of these rounds, with delta = 2 mu: small enough that contacts are meant, large enough that
        they may still change.

    Raises
    ------
    TeamError
        When the models do not fit together, or cannot be moved ahead.
    EngineError
        When the engine is not installed, or a builder cannot be sent to it.

    References
    ----------
    Shorinwa, Devlin, Hawkes & Schwager, DisCo: Distributed Contact-Rich Trajectory Optimization for Forceful
    Multi-Robot Collaboration, 2024, Algorithm 1, doi:10.48550/arXiv.2410.23283
    """

    def __init__(
        self,
        team: Team,
        method: Method | str = "hub",
        *,
        engine: str | Engine = "serial",
        rounds: int = 4,
        mu: float = 1e-2,
    ) -> None:
        if rounds < 1 or not mu > 0:
            raise TeamError(
                f"TeamHorizon: rounds = {rounds!r}, mu = {mu!r}; expected at least 1, and a positive number."
            )
        self.team = team
        # A few rounds in each step, and no closing step: so the robots keep apart by themselves.
        self._method = replace(find_method(method, team), closing=None)
        self._in_steps: Method = replace(
            self._method, barrier=BarrierPath(mu, turn=mu, floor=mu), penalties=None, rounds=rounds
        )
        self._number = 0
        self.engine = find_engine(engine)
        self._state: TeamState | None = None
        self._start()

    def _start(self) -> None:
        with undone_on_failure(self.stop):
            self._work = Coordination(self.team, self._method, self.engine)
            self._needed = {name: set(states) for name, states in self._of_all("start_states").items()}
            self._of_all("advance", {}, 0)  # refuses what cannot be moved ahead

    def plan(self) -> PlanningStep:
        """Make the first plan, with all rounds of the method.

        Returns
        -------
        PlanningStep

        Raises
        ------
        TeamError
            When an agent finds no point in its first round.
        """
        method = self._method
        self._state = method.begin(self._work)
        records: list[Round] = []
        while len(records) < method.rounds and not (records and self._is_good(records[-1])):
            records.append(method.round(self._work, self._state))
        if self._state.mu is not None:
            self._state.mu = self._in_steps.barrier.start
        return PlanningStep(0, records)

    def step(self, measured: Measured, elements: int = 1) -> PlanningStep:
        """Plan from where the team is after so many elements of its plan.

        Parameters
        ----------
        measured : mapping of agent to (mapping of component name to float)
            Values of all states with a fixed initial value, such as ``{"a": {"me.x": 0.1, ...}, "rod": {"body.qx":
            ...}}``. What agents share needs to be given for one of them.
        elements : int
            How many elements of the plan have been carried out.

        Returns
        -------
        PlanningStep

        Raises
        ------
        TeamError
            When states are missing, unknown or not finite, or there is no plan yet.
        """
        state = self._state
        if state is None:
            raise TeamError("TeamHorizon: there is no plan to go on from. Call plan() first.")
        self._move(state, self._starts(measured), elements)
        records = [self._in_steps.round(self._work, state) for _ in range(self._in_steps.rounds)]
        self._number += 1
        return PlanningStep(self._number, records)

    def _move(self, state: TeamState, starts: Mapping[str, Mapping[str, float]], elements: int) -> None:
        """Move the plans of all agents ahead, and take over what they share then."""
        work, of_team, multipliers = self._work, self._work.consensus.of_team, self._multipliers(state)
        asked = {name: (start, elements, multipliers.get(name)) for name, start in starts.items()}
        moved = self.engine.call_all("advance", asked)
        for name, (values, plan, own) in moved.items():
            work.plans[name] = plan
            if name == work.hub:
                state.target = of_team(name, values)
            else:
                number = work.robots.index(name)
                state.values[number], state.multipliers[number] = of_team(name, values), of_team(name, own)
        if not work.hub:
            state.target = state.values.mean(axis=0)

    def _multipliers(self, state: TeamState) -> dict[str, Array]:
        """Each robot's, in the order of its values."""
        of_agent = self._work.consensus.of_agent
        return {name: of_agent(name, own) for name, own in zip(self._work.robots, state.multipliers, strict=True)}

    def change_team(self, team: Team) -> None:
        """Go on with a team that robots have left or joined, from the plans that there are.

        Parameters
        ----------
        team : Team
            Such as ``horizon.team.without("c")``. Agents with a name that was there before keep their plans; others
            start from their guesses, and from where their models say.

        Raises
        ------
        TeamError
            When its models do not fit together, or cannot be moved ahead. The horizon is stopped then.
        """
        before, known = self._state, self._of_all("start_states")
        multipliers = {} if before is None else self._multipliers(before)
        plans = self._work.all_values()
        self.team = team
        self._start()
        if before is None:
            return
        facts, of_team = self._work.facts, self._work.consensus.of_team
        self._of_all("put_on", plans)
        self._state = state = self._work.first_state(self._in_steps.barrier.start)
        state.factors, state.round = before.factors, before.round
        for number, name in enumerate(self._work.robots):
            if name in multipliers and multipliers[name].size == facts[name].values.size:
                state.multipliers[number] = of_team(name, multipliers[name])
        self._move(state, {name: known.get(name, {}) for name in facts}, 0)

    def predicted(self, elements: int = 1) -> dict[str, dict[str, float]]:
        """Where the plan says that each agent is after so many elements.

        Returns
        -------
        dict of agent to (dict of component name to float)
            As `step` wants it; a simulation disturbs it.
        """
        return self._of_all("start_states", elements)

    def read(self, *components: str) -> dict[str, dict[str, Array]]:
        """Values of components in the plan of each robot, such as its actuation ``"me.tau_x"``.

        Parameters
        ----------
        *components : str
            ``{robot}`` stands for the name of the robot, as in `Shared`.

        Returns
        -------
        dict of robot to (dict of component name to float array)
        """
        names = {robot: Shared(*components).names_for(robot) for robot in self._work.robots}
        found = self.engine.call_all("read", {robot: (asked,) for robot, asked in names.items()})
        return {
            robot: {name: values[asked] for name, asked in zip(components, names[robot], strict=True)}
            for robot, values in found.items()
        }

    def stop(self) -> None:
        """End the engine."""
        self.engine.stop()

    def __enter__(self) -> TeamHorizon:
        return self

    def __exit__(self, *raised: object) -> None:
        self.stop()

    def _of_all(self, method: str, *arguments: Any) -> dict[str, Any]:
        """What a method of all agents' problems gives."""
        return self.engine.call_all(method, dict.fromkeys(self._work.facts, arguments))

    def _starts(self, measured: Measured) -> dict[str, dict[str, float]]:
        shared = {quantity.name for fact in self._work.facts.values() for quantity in fact.quantities}
        for agent, states in measured.items():
            if agent not in self._needed:
                raise TeamError(f"no agent '{agent}' was started; there are {', '.join(self._needed)}.")
            for name, number in states.items():
                if name not in self._needed[agent]:
                    raise TeamError(f"agent '{agent}': '{name}' is no state with a fixed initial value.")
                if not np.isfinite(number):
                    raise TeamError(f"agent '{agent}': the measured '{name}' is {number}.")
        common = {name: value for states in measured.values() for name, value in states.items() if name in shared}
        starts = {}
        for agent, needed in self._needed.items():
            starts[agent] = {**{n: v for n, v in common.items() if n in needed}, **measured.get(agent, {})}
            missing = sorted(needed - set(starts[agent]))
            if missing:
                raise TeamError(f"agent '{agent}': no measured value of {', '.join(map(repr, missing))}.")
        return starts

    def _is_good(self, record: Round) -> bool:
        if self.team.physics is None:
            return record.agrees(self._method.tolerance)
        return is_success(record.score)
