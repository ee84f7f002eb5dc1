"""What the user states: declarations, `PhaseBlock`, and the judgement of a trajectory by it."""

from .declarations import Algebraic, Control, Declaration, Duration, Parameter, Start, State
from .phase_block import PhaseBlock, PhaseBlockData
from .verification import Verification

__all__ = [
    "Algebraic",
    "Control",
    "Declaration",
    "Duration",
    "Parameter",
    "PhaseBlock",
    "PhaseBlockData",
    "Start",
    "State",
    "Verification",
]
