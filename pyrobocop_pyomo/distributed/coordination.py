"""What all methods do in a round: orders out, reports in, failures kept apart, numbers recorded."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from pyrobocop_pyomo.errors import TeamError
from pyrobocop_pyomo.execution.engine import AgentFailure, Engine
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE

from .agents import KeepApart, Shared
from .consensus import Consensus
from .messages import Order, ProblemFacts, Report
from .rounds import BarrierPath, PlanScore, Round, TargetedPenalties

logger = logging.getLogger(__name__)

_FIRST_TRIES = 4
_MEMORY = 12
_WORSE = 2.0  # times the last residual: an extrapolation after which it has grown more is not trusted

Plans = Mapping[str, Mapping[str, Array]]


class Physics(Protocol):
    """Scores the combined plan of a team."""

    @property
    def robot_components(self) -> Sequence[str]:
        """Names of what it reads of each robot's plan."""

    @property
    def hub_components(self) -> Sequence[str]:
        """Names of what it reads of the hub's plan."""

    def __call__(self, plans: Plans) -> PlanScore:
        """Score the plans of all agents."""


@dataclass
class AndersonAcceleration:
    """From the last points and their images, the point at which the linear model of the iteration stands still.

    Attributes
    ----------
    steps : list of (point, image)
        The last ones.

    References
    ----------
    Walker & Ni, Anderson acceleration for fixed-point iterations, SIAM J. Numer. Anal. 49 (2011),
    doi:10.1137/10078356X
    """

    steps: list[tuple[Array, Array]] = field(default_factory=list)

    def next(self, point: Array, image: Array) -> Array:
        """Where to go on from.

        Parameters
        ----------
        point : float array, shape (n,)
        image : float array, shape (n,)
            What the iteration made of it.
        """
        if np.linalg.norm(image - point) <= NEGLIGIBLE * np.linalg.norm(image):
            return image  # where it stands still; to extrapolate what rounding leaves would lead anywhere
        if self.steps:
            before, after = self.steps[-1]
            if np.linalg.norm(image - point) > _WORSE * np.linalg.norm(after - before):
                self.steps.clear()
        self.steps = [*self.steps, (point.copy(), image.copy())][-_MEMORY:]
        if len(self.steps) < 2:
            return image
        points, images = (np.array(column) for column in zip(*self.steps, strict=True))
        residuals = np.diff(images - points, axis=0)
        weights = np.linalg.lstsq(residuals.T, image - point, rcond=1e-10)[0]
        accelerated: Array = image - np.diff(images, axis=0).T @ weights
        return accelerated


@dataclass
class TeamState:
    """What a method knows between two rounds, beside the states of the agents: arrays, so that it can be saved.

    Attributes
    ----------
    round : int
        Number of the next round.
    mu : float or None
    factors : float array
    target : float array
        What the hub proposes; the mean of all copies where there is no hub.
    values, multipliers : dict of agent to float array
    positions : dict of agent to float array
    closing_tried : int
        Number of the round after which the closing step was tried last; -1 where it was not.
    acceleration : AndersonAcceleration
        What it remembers of the last rounds, where there are no pairs.
    """

    round: int
    mu: float | None
    factors: Array
    target: Array
    values: dict[str, Array]
    multipliers: dict[str, Array]
    positions: dict[str, Array]
    closing_tried: int = -1
    acceleration: AndersonAcceleration = field(default_factory=AndersonAcceleration)

    def arrays(self) -> dict[str, Array]:
        """Everything as arrays by name."""
        arrays = {
            "round": np.array(self.round),
            "mu": np.array(np.nan if self.mu is None else self.mu),
            "factors": self.factors,
            "target": self.target,
            "closing_tried": np.array(self.closing_tried),
            "steps": np.array(self.acceleration.steps),
        }
        for what in ("values", "multipliers", "positions"):
            arrays.update({f"{what}/{name}": array for name, array in getattr(self, what).items()})
        return {name: np.array(array) for name, array in arrays.items()}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, Array]) -> TeamState:
        """The state that `arrays` gave."""
        parts: dict[str, dict[str, Array]] = {"values": {}, "multipliers": {}, "positions": {}}
        for name, array in arrays.items():
            what, _, agent = name.partition("/")
            if agent:
                parts[what][agent] = np.array(array)
        mu = float(arrays["mu"])
        return cls(
            int(arrays["round"]),
            None if np.isnan(mu) else mu,
            np.array(arrays["factors"]),
            np.array(arrays["target"]),
            **parts,
            closing_tried=int(arrays["closing_tried"]),
            acceleration=AndersonAcceleration([(point, image) for point, image in arrays["steps"]]),
        )


class Residuals(NamedTuple):
    """How far the agents are apart, and how far what they agree on has moved: the largest for each `Shared`.

    Attributes
    ----------
    disagreement, change : float arrays, shape (groups,)
    scaled : float array, shape (groups,)
        Disagreement times the square root of its penalty as given: comparable between groups, whatever their units.
    """

    disagreement: Array
    change: Array
    scaled: Array


@dataclass
class Coordination:
    """A team at work: its engine, what its agents said, and the records of the rounds.

    Attributes
    ----------
    engine : Engine
        Started.
    facts : dict of agent to ProblemFacts
    shared : sequence of Shared
    robots : sequence of str
        Names of the agents that plan a motion of their own.
    hub : str
        Empty where there is none.
    keep_apart : KeepApart or None
        Of the rounds: which distance robots keep from where the others were in the round before.
    physics : Physics or None
    """

    engine: Engine
    facts: dict[str, ProblemFacts]
    shared: Sequence[Shared]
    robots: Sequence[str]
    hub: str
    keep_apart: KeepApart | None
    physics: Physics | None
    rounds: list[Round] = field(default_factory=list)
    plans: dict[str, Mapping[str, Array]] = field(default_factory=dict)
    frozen: dict[str, str] = field(default_factory=dict)
    _asked: dict[str, Report] = field(default_factory=dict)
    _failed: dict[str, str] = field(default_factory=dict)
    _objectives: dict[str, float] = field(default_factory=dict)
    _started: float = 0.0

    def __post_init__(self) -> None:
        """Line the shared values up."""
        self.consensus = Consensus(self.facts, self.shared)

    def first_state(self, mu: float) -> TeamState:
        """The state before any round: no values, multipliers zero, penalties as given; mu where there are pairs."""
        has_pairs = any(fact.pairs for fact in self.facts.values())
        multipliers = {name: np.zeros(self.facts[name].values.size) for name in self.robots}
        positions = {name: fact.positions for name, fact in self.facts.items() if fact.positions is not None}
        return TeamState(
            0, mu if has_pairs else None, np.ones(len(self.shared)), np.zeros(0), {}, multipliers, positions
        )

    def begin_round(self) -> None:
        """Forget the reports of the round before."""
        self._asked, self._failed, self._started = {}, {}, time.perf_counter()

    def ask(self, orders: Mapping[str, Order]) -> dict[str, Report]:
        """Have orders carried out; only the reports that can be used come back."""
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
                if reply.plan:
                    self.plans[name] = reply.plan
            else:
                self._failed[name] = f"Ipopt: {reply.status}"
        return usable

    def ask_until_all(self, orders: Mapping[str, Order]) -> dict[str, Report]:
        """Have orders carried out, again for those without a point: a report may have been lost on its way."""
        reports = self.ask(orders)
        for _ in range(_FIRST_TRIES):
            missing = {name: order for name, order in orders.items() if name not in {*reports, *self.frozen}}
            if not missing:
                break
            reports.update(self.ask(missing))
        return reports

    def all_values(self) -> dict[str, Mapping[str, Array]]:
        """Values of all variables, by agent and by name in its own model."""
        values: dict[str, Mapping[str, Array]] = {}
        for reply in self.engine.call_all("all_values", dict.fromkeys(self.facts, ())).values():
            if not isinstance(reply, AgentFailure):
                values = {**reply, **values}
        return values

    @staticmethod
    def take(state: TeamState, reports: Mapping[str, Report]) -> None:
        """Put the robots' new values and positions into the state; the others keep theirs."""
        state.values.update({name: report.values for name, report in reports.items()})
        state.positions.update({name: r.positions for name, r in reports.items() if r.positions is not None})

    def refuse_missing(self, values: Mapping[str, Any], names: Sequence[str]) -> None:
        """Without a first point of an agent there is nothing to go on from."""
        for name in names:
            if name not in values:
                raise TeamError(
                    f"agent '{name}' found no point in its first round ({self._failed.get(name, 'no report')}). Check "
                    "its model alone: build it and call rcp.solve, or rcp.diagnose. If rcp.solve succeeds by other "
                    "starts or rounds, which agents do not make, let the builder initialize its phases with that plan."
                )

    def end_round(
        self,
        state: TeamState,
        residuals: Residuals,
        barrier: BarrierPath,
        penalties: TargetedPenalties | None,
        *,
        scored: bool,
    ) -> Round:
        """Record the round, with its score where it is wanted, and move the schedules on."""
        score = None
        if scored and self.physics is not None and set(self.plans) >= set(self.robots):
            score = self.physics(self.plans)
        record = Round(
            state.round,
            state.mu,
            *residuals,
            state.factors.copy(),
            float(sum(self._objectives.values())),
            {name: (report.status, report.iterations, report.cpu_seconds) for name, report in self._asked.items()},
            dict(self._failed),
            score,
            time.perf_counter() - self._started,
            self.hub or None,
        )
        self.rounds.append(record)
        if penalties is not None:
            state.factors = penalties.after(state.factors, state.mu, record.scaled)
        if state.mu is not None:
            state.mu = barrier.after(state.mu, record.disagreement)
        state.round += 1
        return record

    def residuals(self, state: TeamState, agreed: Array, before: Array) -> tuple[Residuals, dict[str, Array]]:
        """How far the robots are from what is agreed on now, which has moved since before; and each robot's gap."""
        residuals, gaps = Residuals(*np.zeros((3, len(self.shared)))), {}
        for name in self.robots:
            fact, own = self.facts[name], self.consensus.of_agent(name, agreed)
            gaps[name] = self.consensus.masked(name, state.values[name]) - own
            moved = own - self.consensus.of_agent(name, before)
            np.maximum.at(residuals.disagreement, fact.groups, np.abs(gaps[name]))
            np.maximum.at(residuals.change, fact.groups, np.abs(moved))
            np.maximum.at(residuals.scaled, fact.groups, np.sqrt(fact.penalties) * np.abs(gaps[name]))
        return residuals, gaps

    @staticmethod
    def tolerance(mu: float | None) -> float:
        """Tolerance of a solve: on the way, no more exact than the next barrier problem differs from this one."""
        if mu is None:
            return 1e-8
        return max(1e-6, mu if mu > 1.5e-3 else 0.1 * mu)

    def others(self, positions: Mapping[str, Array]) -> dict[str, Array]:
        """For each robot the positions of the nearest others, at each time of their own."""
        if self.keep_apart is None or len(positions) < 2:
            return {}
        names, points = list(positions), np.array(list(positions.values()))
        count = min(self.keep_apart.neighbours, len(names) - 1)
        distances = np.linalg.norm(points[:, None] - points[None], axis=2)
        nearest: dict[str, Array] = {}
        for i, name in enumerate(names):
            distances[i, i] = np.inf
            # Stable, so that equal distances are taken in the same order everywhere.
            order = np.argsort(distances[i], axis=0, kind="stable")[:count]
            nearest[name] = np.swapaxes(points[order, :, np.arange(points.shape[2])], 1, 2)
        return nearest
