"""Rigid bodies, disc robots, contact between them and its physical score, in the plane."""

from .bodies import DiscRobot, GroundFriction, ViscousDrag
from .bodies import PlanarBody as RigidBody
from .contacts import RobotContact as Contact
from .plan_score import CombinedPlanScore as Score
from .shapes import Capsule, Disc, RoundedBox

__all__ = [
    "Capsule",
    "Contact",
    "Disc",
    "DiscRobot",
    "GroundFriction",
    "RigidBody",
    "RoundedBox",
    "Score",
    "ViscousDrag",
]
