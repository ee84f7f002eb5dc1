"""How far an answer on a mesh is from that of the continuous problem: errors of the motion and of the objective."""

from .estimates import DiscretisationEstimate, PhaseEstimate
from .phase_multipliers import RowMultipliers
from .probe import DiscretisationProbe

__all__ = [
    "DiscretisationEstimate", "DiscretisationProbe", "PhaseEstimate", "RowMultipliers",
]  # fmt: skip
