"""Planning: `solve`, which proves the motion between the nodes safe, and the same as a Pyomo solver."""

from . import older_interface as older_interface  # registers the solver
from .mpcc_solver import Mpcc
from .solve import solve

__all__ = ["Mpcc", "solve"]
