"""What the user states: declarations, `PhaseBlock`, and the verification of a trajectory by it."""

from .declarations import Algebraic, Control, Declaration, Duration, Law, Parameter, Start, State
from .phase_block import PhaseBlock
from .phase_data import PhaseBlockData, note_outcome, phases_of
from .remeshing import remesh_phases, why_not_remeshed
from .verification import Verification

__all__ = [
    "Algebraic",
    "Control",
    "Declaration",
    "Duration",
    "Law",
    "Parameter",
    "PhaseBlock",
    "PhaseBlockData",
    "Start",
    "State",
    "Verification",
    "note_outcome",
    "phases_of",
    "remesh_phases",
    "why_not_remeshed",
]
