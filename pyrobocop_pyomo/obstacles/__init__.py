"""Obstacles: bodies that keep clear of them, how they move between the nodes, and the proof that they do."""

from .avoidance_block import ObstacleAvoidanceBlock
from .avoidance_data import ObstacleAvoidanceBlockData
from .bodies import Body
from .containment import Containment
from .containment_data import ContainmentData
from .formulations import Dual, Formulation, Mixed, Offset, Optimality, Plane
from .motion import Motion, motion_of
from .pictures import animate_avoidance, draw_avoidance
from .safety_report import PairSafety, SafetyReport
from .verification import verify_clearance

__all__ = [
    "Body",
    "Containment",
    "ContainmentData",
    "Dual",
    "Formulation",
    "Mixed",
    "Motion",
    "ObstacleAvoidanceBlock",
    "ObstacleAvoidanceBlockData",
    "Offset",
    "Optimality",
    "PairSafety",
    "Plane",
    "SafetyReport",
    "animate_avoidance",
    "draw_avoidance",
    "motion_of",
    "verify_clearance",
]
