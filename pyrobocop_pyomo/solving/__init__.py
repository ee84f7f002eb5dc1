"""Finding Ipopt, running it in process, and solving complementarity problems by continuation."""

from .in_process import InProcessIpopt
from .ipopt_executable import configure_ipopt_executable
from .kept_model import KeptModel
from .mode_sequences import mode_sequences
from .procedure import solve
from .receding_horizon import HorizonStep, RecedingHorizon
from .routes import Route, available_routes
from .sequence_ranking import SequenceOutcome, SequenceRanking
from .sequence_solver import solve_sequences
from .solve_result import Quality, SolveResult, Step, StopReason

__all__ = [
    "HorizonStep",
    "InProcessIpopt",
    "KeptModel",
    "Quality",
    "RecedingHorizon",
    "Route",
    "SequenceOutcome",
    "SequenceRanking",
    "SolveResult",
    "Step",
    "StopReason",
    "available_routes",
    "configure_ipopt_executable",
    "mode_sequences",
    "solve",
    "solve_sequences",
]
