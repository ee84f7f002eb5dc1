"""Obstacles: bodies that keep clear of them, how they move between the nodes, and the proof that they do."""

from .avoidance_block import ObstacleAvoidanceBlock
from .avoidance_data import ObstacleAvoidanceBlockData
from .bodies import Body
from .formulations import Formulation, Plane
from .motion import Motion, motion_of

__all__ = [
    "Body",
    "Formulation",
    "Motion",
    "ObstacleAvoidanceBlock",
    "ObstacleAvoidanceBlockData",
    "Plane",
    "motion_of",
]
