"""Finding Ipopt and running it: the executable, and the library in this process."""

from .backends import Backend, available_backends, configure_ipopt_executable
from .linear_solvers import linear_solver_options

__all__ = ["Backend", "available_backends", "configure_ipopt_executable", "linear_solver_options"]
