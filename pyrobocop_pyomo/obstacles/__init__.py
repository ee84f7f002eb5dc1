"""Obstacles: bodies that keep clear of them or inside a region, as rows of an ordinary Pyomo block."""

from .avoidance_block import ObstacleAvoidanceBlock, ObstacleAvoidanceBlockData, avoidance_blocks
from .containment import Containment, ContainmentData, containments
from .motion_verification import verify_motion
from .pictures import animate_avoidance, draw_avoidance

__all__ = [
    "Containment",
    "ContainmentData",
    "ObstacleAvoidanceBlock",
    "ObstacleAvoidanceBlockData",
    "animate_avoidance",
    "avoidance_blocks",
    "containments",
    "draw_avoidance",
    "verify_motion",
]
