"""Planning: `solve`, which proves the motion between the nodes safe, and the same as a Pyomo solver."""

from .mpcc_solver import Mpcc  # registers the solver
from .solve import solve

__all__ = ["Mpcc", "solve"]
