"""Finding Ipopt, running it in process, and solving complementarity problems by continuation."""

from .in_process import InProcessIpopt
from .ipopt_executable import configure_ipopt_executable
from .procedure import solve
from .refined_result import RefinedResult, RefinementEnd, RefinementStep
from .refinement import solve_refined
from .routes import Route, available_routes
from .solve_result import Quality, SolveResult, Step, StopReason

__all__ = [
    "InProcessIpopt",
    "Quality",
    "RefinedResult",
    "RefinementEnd",
    "RefinementStep",
    "Route",
    "SolveResult",
    "Step",
    "StopReason",
    "available_routes",
    "configure_ipopt_executable",
    "solve",
    "solve_refined",
]
