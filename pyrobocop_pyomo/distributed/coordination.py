"""What all methods do in a round: orders out, reports in, failures kept apart, numbers recorded.

What has to agree with what: the shared values of all agents, lined up by name and index.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from pyrobocop_pyomo.errors import TeamError
from pyrobocop_pyomo.execution.engine import AgentFailure, Engine
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.optional_imports import scipy

from .agents import Shared
from .rounds import Order, PlanScore, ProblemFacts, QuantityFacts, Report, Round

# -------------------------------------------------------------------------------------------------------- shared values


Key = tuple[str, object]


class Consensus:
    """The shared values of a team.

    A value is agreed on wherever it is free in a model. Models may hold more of a quantity, such as an initial velocity
    that is fixed and that others have no use for: a value that is fixed wherever it exists is left out.

    Parameters
    ----------
    facts : mapping of agent name to ProblemFacts
    shared : sequence of Shared

    Attributes
    ----------
    keys : list of (name, index)
        What the team agrees on.
    groups : int array
        The number of the `Shared` that each belongs to.
    penalties : float array
        As given, of each.

    Raises
    ------
    TeamError
        When a quantity has other indices or units in one model than in another, or nobody else shares it.
    """

    def __init__(self, facts: Mapping[str, ProblemFacts], shared: Sequence[Shared]) -> None:
        self._refuse_other_units(facts)
        free: dict[Key, tuple[int, float]] = {}
        for fact in facts.values():
            for (quantity, key), fixed in zip(_values_of(fact), fact.fixed.tolist(), strict=True):
                if not fixed:
                    free.setdefault((quantity.name, key), (quantity.group, quantity.penalty))
        self._refuse_other_indices(facts, free)
        self.keys = list(free)
        self.groups = np.array([group for group, _ in free.values()], dtype=np.intp)
        self.penalties = np.array([penalty for _, penalty in free.values()], dtype=float)
        # From an agent's values to the team's: a matrix with a one for each value that needs agreement.
        number = {key: i for i, key in enumerate(self.keys)}
        self._to_team: dict[str, Any] = {}
        for name, fact in facts.items():
            keys = [(quantity.name, key) for quantity, key in _values_of(fact)]
            agreed = [i for i, key in enumerate(keys) if key in number]
            places, shape = [number[keys[i]] for i in agreed], (len(number), len(keys))
            self._to_team[name] = scipy.sparse.csr_array((np.ones(len(agreed)), (places, agreed)), shape=shape)

    @staticmethod
    def _refuse_other_units(facts: Mapping[str, ProblemFacts]) -> None:
        units: dict[str, tuple[str, str]] = {}
        for name, fact in facts.items():
            for quantity in fact.quantities:
                first, known = units.setdefault(quantity.name, (name, quantity.units))
                if known != quantity.units:
                    raise TeamError(
                        f"'{quantity.name}' is in {known or 'no unit'} in the model of '{first}' and in "
                        f"{quantity.units or 'no unit'} in that of '{name}'. Declare the same units."
                    )

    @staticmethod
    def _refuse_other_indices(facts: Mapping[str, ProblemFacts], free: Iterable[Key]) -> None:
        held = {name: {of.name: set(of.keys) for of in fact.quantities} for name, fact in facts.items()}
        for label, index in free:
            holders = [name for name in facts if label in held[name]]
            if len(holders) == 1:
                raise TeamError(
                    f"'{label}' is shared by '{holders[0]}' alone: no other model has it. Check its name, or leave it "
                    "out."
                )
            without = next((name for name in holders if index not in held[name][label]), None)
            if without is not None:
                other = next(name for name in holders if index in held[name][label])
                raise TeamError(
                    f"'{label}' has {len(held[without][label])} values in the model of '{without}' and "
                    f"{len(held[other][label])} in that of '{other}': index {index} is missing in the first. "
                    "Give both models the same horizon and mesh."
                )

    def of_agent(self, name: str, team_values: Array) -> Array:
        """The team's values in the order of an agent's; 0 where no agreement is needed."""
        return self._to_team[name].T @ team_values

    def of_team(self, name: str, values: Array) -> Array:
        """An agent's values in the order of the team's; 0 where it has none."""
        return self._to_team[name] @ values

    def weights(self, factors: Array) -> Array:
        """The penalties, each group of them times its factor."""
        return factors[self.groups] * self.penalties


def _values_of(fact: ProblemFacts) -> Iterator[tuple[QuantityFacts, object]]:
    return ((quantity, key) for quantity in fact.quantities for key in quantity.keys)


# --------------------------------------------------------------------------------------------------------- coordination


logger = logging.getLogger(__name__)

_FIRST_TRIES = 4
_MEMORY = 12
_WORSE = 2.0  # times the last residual: an extrapolation after which it has grown more is not trusted

Plans = Mapping[str, Mapping[str, Array]]


class Physics(Protocol):
    """Scores the combined plan of a team."""

    @property
    def robot_components(self) -> Sequence[str]:
        """Names of the components that it reads of each robot's plan."""

    @property
    def hub_components(self) -> Sequence[str]:
        """Names of the components that it reads of the hub's plan."""

    def __call__(self, plans: Plans) -> PlanScore:
        """Score the plans of all agents."""


def extrapolated(steps: list[Array], point: Array, image: Array) -> Array:
    """Where an iteration goes on from: the point at which its linear model stands still (Anderson acceleration).

    Parameters
    ----------
    steps : list of array, shape (2, n)
        The last points and images; this one is added.
    point : float array, shape (n,)
    image : float array, shape (n,)
        What the iteration made of it.

    References
    ----------
    Walker & Ni, Anderson acceleration for fixed-point iterations, SIAM J. Numer. Anal. 49 (2011),
    doi:10.1137/10078356X
    """
    if np.linalg.norm(image - point) <= NEGLIGIBLE * np.linalg.norm(image):
        return image  # where it stands still; to extrapolate what rounding leaves would lead anywhere
    if steps:
        before, after = steps[-1]
        if np.linalg.norm(image - point) > _WORSE * np.linalg.norm(after - before):
            steps.clear()
    steps[:] = [*steps, np.array([point, image])][-_MEMORY:]
    if len(steps) < 2:
        return image
    points, images = np.array(steps).swapaxes(0, 1)
    residuals = np.diff(images - points, axis=0)
    weights = np.linalg.lstsq(residuals.T, image - point, rcond=1e-10)[0]
    return image - np.diff(images, axis=0).T @ weights


@dataclass
class TeamState:
    """What a method knows between two rounds, beside the states of the agents: arrays, so that it can be saved.

    Attributes
    ----------
    round : int
        Number of the next round.
    mu : float or None
    factors : float array
        On the penalties of each `Shared`.
    target : float array, shape (n,)
        What the hub proposes, the mean of all copies where there is no hub, for each of `Consensus.keys`.
    values, multipliers : float array, shape (robots, n)
        0 for what a robot does not hold.
    closing_tried : int
        Number of the round after which the closing step was tried last; -1 where it was not.
    steps : list of array, shape (2, size)
        What the acceleration remembers of the last rounds, where there are no pairs.
    """

    round: int
    mu: float | None
    factors: Array
    target: Array
    values: Array
    multipliers: Array
    closing_tried: int = -1
    steps: list[Array] = field(default_factory=list)

    def arrays(self) -> dict[str, Array]:
        """The whole state as arrays by name."""
        return {name: np.array(held) for name, held in vars(self).items() if held is not None}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, Array]) -> TeamState:
        """The state that `arrays` gave."""
        held: dict[str, Any] = {name: np.array(array) if array.ndim else array.item() for name, array in arrays.items()}
        return cls(**{"mu": None, **held, "steps": list(held["steps"])})


class Coordination:
    """A team at work: its engine, what its agents said, and the records of the rounds.

    Parameters
    ----------
    team : Team
    method : Method
    engine : Engine
        It is started here: all agents are built on it.

    Attributes
    ----------
    facts : dict of agent to ProblemFacts
    consensus : Consensus
    held : float array, shape (robots, n)
        1 for each of the team's values that a robot holds, 0 for the others.
    robots : sequence of str
        Names of the agents that plan a motion of their own.
    hub : str
        Empty where there is none.
    nearest : dict of agent to float array
        Positions that it keeps away from in this round.
    plans : dict of agent to (mapping of component name to float array)
        The last ones that could be used.

    Raises
    ------
    TeamError
        When the models do not fit together.
    EngineError
        When an agent cannot be sent or built.
    """

    def __init__(self, team: Any, method: Any, engine: Engine) -> None:
        self.team, self.engine, self.robots = team, engine, team.names
        self.hub = team.hub.name if method.has_hub else ""
        specs = team.problem_specs(method)
        self._neighbours = max(spec.neighbours for spec in specs)
        self.facts: dict[str, ProblemFacts] = engine.start(specs)
        self.plans = {name: fact.plan for name, fact in self.facts.items()}
        self._check()
        self.consensus = Consensus(self.facts, team.shared)
        ones = {robot: np.ones(self.facts[robot].fixed.size) for robot in self.robots}
        self.held = np.array([self.consensus.of_team(robot, values) for robot, values in ones.items()])
        self.rounds: list[Round] = []
        self.frozen: dict[str, str] = {}
        self._objectives: dict[str, float] = {}

    def _check(self) -> None:
        # A control of the hub that a robot has as well is a force of the robot: the hub alone cannot choose it.
        controls = {name: own for fact in self.facts.values() for name, own in fact.own_controls.items()}
        of_hub = () if self.team.hub is None else controls[self.team.hub.name]
        for robot in self.robots:
            both = [name for name in controls[robot] if name in of_hub]
            if both:
                raise TeamError(
                    f"{', '.join(map(repr, both))}: a control in the models of the hub and of '{robot}' that they do "
                    "not share, so that each would choose values of its own. Add Shared(...) with it, such as "
                    "Shared('push[{robot}]') for the wrench of each robot."
                )
        rule = self.team.keep_apart
        if rule is not None and len({self.plans[robot][rule.components[0]].shape for robot in self.robots}) > 1:
            raise TeamError(
                "KeepApart: the robots have positions at different numbers of times. Give all the same mesh."
            )

    def first_state(self, mu: float) -> TeamState:
        """The state before any round: no values, multipliers zero, penalties as given; mu where there are pairs."""
        has_pairs = any(fact.has_pairs for fact in self.facts.values())
        target, factors = np.zeros(len(self.consensus.keys)), np.ones(len(self.team.shared))
        zeros = np.zeros_like(self.held)
        return TeamState(0, mu if has_pairs else None, factors, target, zeros, zeros.copy())

    def begin_round(self) -> None:
        """Forget the reports of the round before, and see who is near."""
        self._asked: dict[str, Report] = {}
        self._failed: dict[str, str] = {}
        self.nearest = self._nearest()

    def ask(self, orders: Mapping[str, Order], *, until_all: bool = False) -> dict[str, Report]:
        """Have orders carried out; only the reports that can be used come back.

        Parameters
        ----------
        orders : mapping of agent to Order
        until_all : bool
            Ask again for those that are missing: a report may have been lost on its way.

        Raises
        ------
        TeamError
            Where one is missing all the same: without a first point of an agent there is nothing to go on from.
        """
        reports = self._ask(orders)
        for _ in range(_FIRST_TRIES if until_all else 0):
            missing = {name: order for name, order in orders.items() if name not in reports}
            reports.update(self._ask(missing) if missing else {})
        for name in orders if until_all else ():
            if name not in reports:
                raise TeamError(
                    f"agent '{name}' found no point in its first round ({self._failed.get(name, 'no report')}). Check "
                    "its model alone: build it and call rcp.solve, or rcp.diagnose. If rcp.solve succeeds by other "
                    "starts or rounds, which agents do not make, let the builder initialize its phases with that plan."
                )
        return reports

    def _ask(self, orders: Mapping[str, Order]) -> dict[str, Report]:
        wanted = {name: order for name, order in orders.items() if name not in self.frozen}
        usable: dict[str, Report] = {}
        for name, reply in self.engine.solve(wanted).items():
            if isinstance(reply, AgentFailure):
                self._failed[name] = reply.reason
                if reply.final:
                    logger.error("agent '%s' is frozen at its last plan: %s", name, reply.reason)
                    self.frozen[name] = reply.reason
                continue
            if reply.status == IpoptStatus.INTERRUPTED.name:
                # Ipopt turns Ctrl-C into a status; whoever pressed it wants the rounds to stop.
                raise KeyboardInterrupt
            self._asked[name] = reply
            if reply.usable and np.isfinite(reply.values).all():
                usable[name] = reply
                self._objectives[name] = reply.objective
                self.plans[name] = reply.plan
            else:
                self._failed[name] = f"Ipopt: {reply.status}"
        return usable

    def all_values(self) -> dict[str, Mapping[str, Array]]:
        """Values of all variables, by agent and by name in its own model."""
        values: dict[str, Mapping[str, Array]] = {}
        for reply in self.engine.call_all("all_values", dict.fromkeys(self.facts, ())).values():
            values = {**reply, **values}
        return values

    def continue_from(self, states: Mapping[str, Mapping[str, Array]]) -> None:
        """Put agents into states that the engine gave, and see what their plans are there."""
        self.engine.restore(states)
        self.plans.update(self.engine.call_all("plan", dict.fromkeys(self.facts, ())))

    def take(self, state: TeamState, reports: Mapping[str, Report]) -> None:
        """Put the robots' new values into the state; the others keep theirs."""
        for number, name in enumerate(self.robots):
            if name in reports:
                state.values[number] = self.consensus.of_team(name, reports[name].values)

    def values_of(self, name: str, values: Array) -> Array:
        """The team's values in the order of an agent's; what is fixed wherever it exists as in its model."""
        is_agreed = self.consensus.of_agent(name, np.ones_like(values)) > 0
        return np.where(is_agreed, self.consensus.of_agent(name, values), self.facts[name].values)

    def end_round(self, state: TeamState, gaps: Array, moved: Array, *, scored: bool) -> Round:
        """Record the round, with the score of its plan where that is wanted and there is physics.

        Parameters
        ----------
        state : TeamState
        gaps : float array, shape (robots, n)
            From the agreed values to the robots' values.
        moved : float array, shape (n,)
            The change of the agreed values.
        scored : bool
        """
        physics, apart = self.team.physics, np.abs(gaps).max(axis=0)
        score = physics(self.plans) if scored and physics is not None else None
        record = Round(
            state.round,
            state.mu,
            self._largest(apart),
            self._largest(np.abs(moved)),
            self._largest(np.sqrt(self.consensus.penalties) * apart),
            state.factors.copy(),
            float(sum(self._objectives.values())),
            {name: (report.status, report.iterations, report.cpu_seconds) for name, report in self._asked.items()},
            dict(self._failed),
            score,
        )
        self.rounds.append(record)
        state.round += 1
        return record

    def extrapolate(self, state: TeamState, target: Array, multipliers: Array, *, is_complete: bool) -> None:
        """Go on from where a round without pairs leads, not from where it has ended.

        Parameters
        ----------
        state : TeamState
        target, multipliers : float arrays
            Before the round.
        is_complete : bool
            Whether all robots have reported: another round is no value of the map that is learned.
        """
        if state.mu is not None or not is_complete:
            state.steps.clear()
            return
        scale = np.sqrt(self.consensus.penalties)  # in comparable units
        point = np.vstack([target * scale, multipliers / scale])
        image = np.vstack([state.target * scale, state.multipliers / scale])
        moved = extrapolated(state.steps, point.ravel(), image.ravel()).reshape(point.shape)
        state.target, state.multipliers = moved[0] / scale, moved[1:] * scale

    def _largest(self, values: Array) -> Array:
        """Of each `Shared`."""
        largest = np.zeros(len(self.team.shared))
        np.maximum.at(largest, self.consensus.groups, values)
        return largest

    def _nearest(self) -> dict[str, Array]:
        """For each robot the positions of the nearest others, at each time of their own."""
        if not self._neighbours:
            return {}
        components = self.team.keep_apart.components
        points = np.array([[self.plans[robot][component] for component in components] for robot in self.robots])
        distances = np.linalg.norm(points[:, None] - points[None], axis=2)
        nearest: dict[str, Array] = {}
        for i, name in enumerate(self.robots):
            distances[i, i] = np.inf
            # Stable, so that equal distances are taken in the same order everywhere.
            order = np.argsort(distances[i], axis=0, kind="stable")[: self._neighbours]
            nearest[name] = np.swapaxes(points[order, :, np.arange(points.shape[2])], 1, 2)
        return nearest
