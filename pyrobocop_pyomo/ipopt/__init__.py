"""Finding Ipopt and running it: the executable, and the library in this process."""

from .in_process import InProcessIpopt
from .ipopt_executable import configure_ipopt_executable
from .routes import Route, available_routes

__all__ = ["InProcessIpopt", "Route", "available_routes", "configure_ipopt_executable"]
