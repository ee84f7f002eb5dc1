"""`Method`: what both ways to agree have in common, the numbers of their rounds."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from pyrobocop_pyomo.errors import TeamError
from pyrobocop_pyomo.numerics import Array

from .closing import Closing
from .coordination import Coordination, Residuals, TeamState
from .messages import Order, Report
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
        factors: Array,
        *,
        weights: Array | float = 1.0,
        first: bool = False,
        **further: Any,
    ) -> Order:
        """What an agent solves: the barrier problem of mu where it has pairs.

        Parameters
        ----------
        work : Coordination
        name : str
        state : TeamState
        linear : float array
            As of `Order`.
        factors : float array
            One for each `Shared`, on its penalty.
        weights : float array, shape (n,), or float
            Further factors on the penalty of each value.
        first : bool
            Whether there is no solve to go on from.
        **further
            What else the `Order` has, or has instead.
        """
        fact = work.facts[name]
        mu = state.mu if fact.has_pairs else None
        usual = {
            "tolerance": work.tolerance(mu),
            "iterations": max(FIRST_ITERATIONS, self.iterations) if first else self.iterations,
            "others": work.nearest.get(name),
        }
        return Order(linear, fact.weighted(factors, weights), mu, **{**usual, **further})

    @abstractmethod
    def begin(self, work: Coordination) -> TeamState:
        """Make the first state."""

    def round(self, work: Coordination, state: TeamState) -> Round:
        """Carry out a round: all robots, then what they agree on and their multipliers."""
        work.begin_round()
        is_first, is_late = not state.values, self.until == "rounds" or state.mu is None or state.mu <= self.score_below
        orders = {name: self.order_of_robot(work, name, state, first=is_first) for name in work.robots}
        reports = work.ask(orders, until_all=is_first)
        state.values.update({name: report.values for name, report in reports.items()})
        residuals = self.agree(work, state, reports)
        record = work.end_round(state, residuals, scored=is_late)
        if self.penalties is not None and (state.mu is not None or not self.has_hub):
            state.factors = self.penalties.after(state.factors, state.mu, record.scaled)
        if state.mu is not None:
            state.mu = self.barrier.after(state.mu, record.disagreement)
        return record

    @abstractmethod
    def order_of_robot(self, work: Coordination, name: str, state: TeamState, *, first: bool) -> Order:
        """What a robot solves in a round."""

    @abstractmethod
    def agree(self, work: Coordination, state: TeamState, reports: Mapping[str, Report]) -> Residuals:
        """Move target and multipliers on after the robots' reports; gives the residuals of the round."""
