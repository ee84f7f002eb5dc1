"""Obstacles: bodies that keep clear of them or inside a region, as rows of an ordinary Pyomo block."""

from .avoidance_block import ObstacleAvoidanceBlock, ObstacleAvoidanceBlockData
from .clearances import FreeClearance
from .containment import Containment, ContainmentData
from .formulations import Dual, Formulation, Mixed, Offset, Optimality, Plane, TurningPlane
from .motion_verification import verify_motion
from .parking_model import parking_model
from .pictures import animate_avoidance, draw_avoidance
from .sampled_path import sampled_path
from .waypoint_initial_guess import waypoint_initial_guess

__all__ = [
    "Containment",
    "ContainmentData",
    "Dual",
    "Formulation",
    "FreeClearance",
    "Mixed",
    "ObstacleAvoidanceBlock",
    "ObstacleAvoidanceBlockData",
    "Offset",
    "Optimality",
    "Plane",
    "TurningPlane",
    "animate_avoidance",
    "draw_avoidance",
    "parking_model",
    "sampled_path",
    "verify_motion",
    "waypoint_initial_guess",
]
