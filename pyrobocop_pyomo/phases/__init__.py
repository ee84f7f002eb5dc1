"""What the user states: declarations, `PhaseBlock`, and the judgement of a trajectory by it."""

from .declarations import Algebraic, Control, Declaration, Duration, Parameter, Start, State
from .links import Link, LinkData
from .phase_block import PhaseBlock, PhaseBlockData
from .phase_end import PhaseEnd
from .verification import Verification

__all__ = [
    "Algebraic",
    "Control",
    "Declaration",
    "Duration",
    "Link",
    "LinkData",
    "Parameter",
    "PhaseBlock",
    "PhaseBlockData",
    "PhaseEnd",
    "Start",
    "State",
    "Verification",
]
