"""What the user states: declarations, `PhaseBlock`, and the judgement of a trajectory by it."""

from .declarations import Algebraic, Control, Declaration, Duration, Parameter, State
from .measurements import label_measurements
from .mpc_interface import PhaseInterface
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
    "PhaseInterface",
    "State",
    "Verification",
    "label_measurements",
]
