"""`Method`: what both ways to agree have in common, the numbers of their rounds."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from pyrobocop_pyomo.errors import TeamError
from pyrobocop_pyomo.numerics import Array

from .closing import Closing
from .coordination import Coordination, TeamState
from .messages import Order
from .rounds import ENDINGS, BarrierPath, Round, TargetedPenalties

FIRST_ITERATIONS = 300  # least limit of a solve without one to go on from


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
        Without physics: largest disagreement, and largest change of what is agreed on in a round.
    iterations : int
        Limit of Ipopt's iterations per solve after the first round.
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
    iterations: int = 150
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
        *,
        first: bool = False,
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
        first : bool
            Whether there is no solve to go on from.
        **further
            What else the `Order` has, or has instead.
        """
        mu = state.mu if work.facts[name].has_pairs else None
        usual = {
            "tolerance": work.tolerance(mu),
            "iterations": max(FIRST_ITERATIONS, self.iterations) if first else self.iterations,
            "others": work.nearest.get(name),
        }
        of_agent = work.consensus.of_agent
        return Order(of_agent(name, linear), of_agent(name, diagonal), mu, **{**usual, **further})

    @abstractmethod
    def begin(self, work: Coordination) -> TeamState:
        """Make the first state."""

    def round(self, work: Coordination, state: TeamState) -> Round:
        """Carry out a round: all robots, then what they agree on and their multipliers."""
        work.begin_round()
        is_first = self.has_hub and state.round == 0
        is_late = self.until == "rounds" or state.mu is None or state.mu <= self.score_below
        linear, diagonal = self.pull(work, state)
        orders = {}
        for name, own in zip(work.robots, linear, strict=True):
            start = work.consensus.of_agent(name, state.target) if is_first else None
            orders[name] = self.order(work, name, state, own, diagonal, first=is_first, values=start)
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
        """What is agreed on after the robots' reports."""
