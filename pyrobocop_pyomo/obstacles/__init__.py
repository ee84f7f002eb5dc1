"""Obstacles: bodies that keep clear of them, the proof that they do between the nodes too, and guesses around them."""

from .avoidance_block import ObstacleAvoidanceBlock
from .avoidance_data import ObstacleAvoidanceBlockData
from .bodies import Body
from .car_moves import CarSearch
from .car_path import CarPath
from .car_timing import CarTiming
from .containment import Containment
from .containment_data import ContainmentData
from .formulations import Dual, Formulation, Mixed, Offset, Optimality, Plane
from .hybrid_a_star import hybrid_a_star
from .motion import Motion, motion_of
from .pictures import animate_avoidance, draw_avoidance
from .safety_report import PairSafety, SafetyReport
from .verification import verify_clearance
from .waypoint_guess import waypoint_guess

__all__ = [
    "Body",
    "CarPath",
    "CarSearch",
    "CarTiming",
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
    "hybrid_a_star",
    "motion_of",
    "verify_clearance",
    "waypoint_guess",
]
