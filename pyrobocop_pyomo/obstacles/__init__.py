"""Obstacles: bodies that keep clear of them or inside a region, as rows of an ordinary Pyomo block."""

from .avoidance_block import ObstacleAvoidanceBlock, ObstacleAvoidanceBlockData
from .containment import Containment, ContainmentData
from .formulations import Dual, Formulation, Mixed, Offset, Optimality, Plane
from .pictures import animate_avoidance, draw_avoidance
from .waypoint_initial_guess import waypoint_initial_guess

__all__ = [
    "Containment",
    "ContainmentData",
    "Dual",
    "Formulation",
    "Mixed",
    "ObstacleAvoidanceBlock",
    "ObstacleAvoidanceBlockData",
    "Offset",
    "Optimality",
    "Plane",
    "animate_avoidance",
    "draw_avoidance",
    "waypoint_initial_guess",
]
