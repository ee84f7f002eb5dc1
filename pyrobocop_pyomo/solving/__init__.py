"""Finding Ipopt, running it in process, and solving complementarity problems by continuation."""

from .in_process import InProcessIpopt
from .ipopt_executable import configure_ipopt_executable
from .kept_model import KeptModel
from .procedure import solve
from .routes import Route, available_routes
from .solve_result import Quality, SolveResult, Step, StopReason

__all__ = [
    "InProcessIpopt",
    "KeptModel",
    "Quality",
    "Route",
    "SolveResult",
    "Step",
    "StopReason",
    "available_routes",
    "configure_ipopt_executable",
    "solve",
]
