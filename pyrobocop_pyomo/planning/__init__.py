"""Planning: `solve`, which proves the motion between the nodes safe, and the same as a Pyomo solver."""

from . import older_interface as older_interface  # registers the solver
from .mpcc_solver import Mpcc
from .solve import solve
from .vehicles_in_turn import VehicleMove, VehiclesPlan, plan_vehicles

__all__ = ["Mpcc", "VehicleMove", "VehiclesPlan", "plan_vehicles", "solve"]
