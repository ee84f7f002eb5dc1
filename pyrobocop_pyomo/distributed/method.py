"""`Method`: what both ways to agree have in common, the numbers of their rounds."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

from pyrobocop_pyomo.errors import TeamError

from .closing import Closing
from .coordination import Coordination, TeamState
from .rounds import ENDINGS, Round
from .team_schedules import BarrierPath, TargetedPenalties


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
        For teams with physics: when one planner makes exact what the agents have nearly agreed on.

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

    def __post_init__(self) -> None:
        """Refuse rounds without an end, or none at all."""
        name = type(self).__name__
        if not self.rounds >= 1:
            raise TeamError(f"{name}: rounds = {self.rounds!r}; expected at least 1.")
        if self.until not in ENDINGS:
            raise TeamError(f"{name}: until = {self.until!r}; expected {', '.join(map(repr, ENDINGS))}.")

    @abstractmethod
    def begin(self, work: Coordination) -> TeamState:
        """Make the first state."""

    @abstractmethod
    def round(self, work: Coordination, state: TeamState) -> Round:
        """Carry out a round."""
