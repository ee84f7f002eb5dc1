"""How the agents of a team come to agree: `Hub`, and `Sova`, the method of the DisCo paper."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from pyrobocop_pyomo.errors import TeamError
from pyrobocop_pyomo.numerics import Array

from .closing import Closing
from .coordination import Coordination, TeamState
from .rounds import ENDINGS, BarrierPath, Order, Round, TargetedPenalties


@dataclass(frozen=True)
class Method(ABC):
    """How the agents of a team come to agree: rounds along the barrier path.

    Attributes
    ----------
    barrier : BarrierPath
    penalties : TargetedPenalties or None
        None keeps them as they are given.
    rounds : int
        At most.
    until : {"strict", "practical", "rounds"}
        Which physical score ends the rounds, for teams with physics; "rounds" goes on to the last. Success is a
        plan that is at least practical.
    tolerance : float
        Without physics: largest disagreement, and largest change of an agreed value in a round.
    iterations : int
        Limit of Ipopt's iterations per solve.
    score_below : float
        The plan is scored from this mu on.
    closing : Closing or None
        When one planner makes exact what the agents have nearly agreed on.

    Raises
    ------
    TeamError
        For less than one round, or an unknown ending.
    """

    barrier: BarrierPath = field(default_factory=BarrierPath)
    penalties: TargetedPenalties | None = field(default_factory=TargetedPenalties)
    rounds: int = 200
    until: str = "strict"
    tolerance: float = 1e-6
    iterations: int = 300
    score_below: float = 2e-3
    closing: Closing | None = field(default_factory=Closing)

    has_hub: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Refuse rounds without an end, or none at all."""
        name = type(self).__name__
        if not self.rounds >= 1:
            raise TeamError(f"{name}: rounds = {self.rounds!r}; expected at least 1.")
        if self.until not in ENDINGS:
            raise TeamError(f"{name}: until = {self.until!r}; expected {', '.join(map(repr, ENDINGS))}.")

    def order(
        self,
        work: Coordination,
        name: str,
        state: TeamState,
        linear: Array,
        diagonal: Array,
        **further: Any,
    ) -> Order:
        """What an agent solves: the barrier problem of mu where it has pairs.

        Parameters
        ----------
        work : Coordination
        name : str
        state : TeamState
        linear, diagonal : float arrays
            As of `Order`, for each of the team's values.
        **further
            What else the `Order` has, or has instead.
        """
        mu = state.mu if work.facts[name].has_pairs else None
        # On the way, no more exact than the next barrier problem differs from this one.
        tolerance = 1e-8 if mu is None else max(1e-6, mu if mu > 1.5e-3 else 0.1 * mu)
        usual = {"tolerance": tolerance, "iterations": self.iterations, "others": work.nearest.get(name)}
        of_agent = work.consensus.of_agent
        return Order(of_agent(name, linear), of_agent(name, diagonal), mu, **{**usual, **further})

    @abstractmethod
    def begin(self, work: Coordination) -> TeamState:
        """Make the first state."""

    def round(self, work: Coordination, state: TeamState) -> Round:
        """Carry out a round: all robots, then the agreed values and their multipliers."""
        work.begin_round()
        is_first = self.has_hub and state.round == 0
        is_late = self.until == "rounds" or state.mu is None or state.mu <= self.score_below
        linear, diagonal = self.pull(work, state)
        orders = {}
        for name, own in zip(work.robots, linear, strict=True):
            start = work.consensus.of_agent(name, state.target) if is_first else None
            orders[name] = self.order(work, name, state, own, diagonal, values=start)
        reports = work.ask(orders, until_all=is_first)
        work.take(state, reports)
        before, state.target = state.target, self.next_target(work, state)
        gaps = work.held * (state.values - state.target)
        record = work.end_round(state, gaps, state.target - before, scored=is_late)
        multipliers = state.multipliers
        # Without a hub a robot's distances from all others add up to so many times that from their mean. With one, the
        # multipliers of a robot without a new plan stay.
        rates = np.array([[name in reports] for name in work.robots]) if self.has_hub else len(work.robots)
        state.multipliers = multipliers + work.consensus.weights(state.factors) * rates * gaps
        if self.has_hub:
            work.extrapolate(state, before, multipliers, is_complete=len(reports) == len(work.robots))
        if self.penalties is not None and (state.mu is not None or not self.has_hub):
            state.factors = self.penalties.after(state.factors, state.mu, record.scaled)
        if state.mu is not None:
            state.mu = self.barrier.after(state.mu, record.disagreement)
        return record

    @abstractmethod
    def pull(self, work: Coordination, state: TeamState) -> tuple[Array, Array]:
        """The terms that a round adds to the robots' objectives.

        Returns
        -------
        linear : float array, shape (robots, n)
        diagonal : float array, shape (n,)
        """

    @abstractmethod
    def next_target(self, work: Coordination, state: TeamState) -> Array:
        """The agreed values after the robots' reports."""


@dataclass(frozen=True)
class Hub(Method):
    r"""Rounds between the hub and the robots.

    In each round every robot i minimises its own objective plus
    :math:`\lambda_i^T s_i + \tfrac12 \|s_i - z_i\|_R^2` over its plan, with s_i its shared values and z_i what the hub
    proposes. The hub then minimises its own objective plus :math:`\sum_i -\lambda_i^T z_i + \tfrac12 \|s_i -
    z_i\|_R^2`, and :math:`\lambda_i \leftarrow \lambda_i + R (s_i - z_i)`. The rounds follow the barrier path: pairs
    are relaxed with delta = 2 mu, and each round solves the barrier problem of its mu, warm in primal and dual. A
    robot's problem does not grow with the team.

    Beside the fields of `Method`; without pairs penalties stay as they are given, and the rounds are accelerated
    (`extrapolated`).

    Attributes
    ----------
    object_first : float
        Factor on the penalties of what a single robot shares with the hub in the hub's first problem, before any round:
        the wrenches that alone would move the object to its goal are kept small.
    early : float
        How much more than a late one an early value costs in that first problem: robots have to arrive before they
        push, while the object alone may move at any time.

    Notes
    -----
    A heuristic for problems with contact: no theorem covers consensus among local solutions of relaxed problems. What
    holds is what the physical score recomputes.

    References
    ----------
    Shorinwa, Devlin, Hawkes & Schwager, DisCo: Distributed Contact-Rich Trajectory Optimization for Forceful
    Multi-Robot Collaboration, 2024, doi:10.48550/arXiv.2410.23283; Boyd et al., Distributed optimization and
    statistical learning via the alternating direction method of multipliers, sec. 7.2, doi:10.1561/2200000016
    """

    object_first: float = 0.28
    early: float = 4.0

    has_hub: ClassVar[bool] = True

    def begin(self, work: Coordination) -> TeamState:
        """Ask the hub for a first motion of the object, and start there."""
        hub, state = work.hub, work.first_state(self.barrier.start)
        work.begin_round()
        single = np.array([self.object_first if shared.of_one_robot else 0.0 for shared in work.team.shared])
        # Factors that fall along the index of each quantity to 1 at its end.
        lengths = [len(quantity.keys) for quantity in work.facts[hub].quantities]
        falling = np.concatenate([1.0 + self.early * np.linspace(1.0, 0.0, length) ** 2 for length in lengths])
        diagonal = work.consensus.weights(single) * work.consensus.of_team(hub, falling)
        order = self.order(work, hub, state, np.zeros_like(diagonal), diagonal, tolerance=1e-6)
        state.target = work.consensus.of_team(hub, work.ask({hub: order}, until_all=True)[hub].values)
        return state

    def pull(self, work: Coordination, state: TeamState) -> tuple[Array, Array]:
        """Towards the hub's proposal."""
        weights = work.consensus.weights(state.factors)
        return state.multipliers - weights * state.target, weights

    def next_target(self, work: Coordination, state: TeamState) -> Array:
        """The hub's answer to the robots' values."""
        hub, weights = work.hub, work.consensus.weights(state.factors)
        linear = (-state.multipliers - weights * state.values).sum(axis=0)
        diagonal = weights * work.held.sum(axis=0)
        reports = work.ask({hub: self.order(work, hub, state, linear, diagonal)})
        return work.consensus.of_team(hub, reports[hub].values) if hub in reports else state.target


@dataclass(frozen=True)
class Sova(Method):
    r"""Rounds among robots that each plan with a copy of everything that is shared.

    In each round robot i minimises its own objective plus
    :math:`p_i^T v_i + \sum_{j \in N_i} \| v_i - \tfrac12 (v_i^k + v_j^k) \|_W^2`, sends its values to its neighbours,
    and :math:`p_i \leftarrow p_i + W \sum_{j \in N_i} (v_i - v_j)`. The multipliers of all robots sum to zero in every
    round. A robot's problem holds the object's dynamics and the wrenches of all robots, so it grows with the team.

    Beside the fields of `Method`:

    Attributes
    ----------
    regularisation : float
        Factor on the penalties in the first round, which has no consensus terms: the copies of the others' wrenches
        would be free otherwise.

    References
    ----------
    Shorinwa, Devlin, Hawkes & Schwager, DisCo, 2024, eq. 18-20 and algorithm 2, doi:10.48550/arXiv.2410.23283
    """

    regularisation: float = 0.1

    def begin(self, work: Coordination) -> TeamState:
        """A first plan of each robot alone, as if the others did whatever helps it."""
        state = work.first_state(self.barrier.start)
        work.begin_round()
        weights = work.consensus.weights(state.factors * self.regularisation)
        orders = {name: self.order(work, name, state, state.target, weights) for name in work.robots}
        work.take(state, work.ask(orders, until_all=True))
        state.target = state.values.mean(axis=0)
        return state

    def pull(self, work: Coordination, state: TeamState) -> tuple[Array, Array]:
        """Towards the middle between each robot's values and the values of all others, which the mean of all tells."""
        weights, count = work.consensus.weights(state.factors), len(work.robots)
        between = count * state.target + (count - 2) * state.values
        return state.multipliers - weights * between, 2.0 * (count - 1) * weights

    def next_target(self, work: Coordination, state: TeamState) -> Array:
        """The mean of all."""
        return state.values.mean(axis=0)
