"""Rigid bodies, sphere robots, contact between them and its physical score, in space."""

from .bodies import SpatialBody as RigidBody
from .bodies import SphereRobot
from .contacts import RobotContact as Contact
from .plan_score import CombinedPlanScore as Score
from .shapes import SpatialBox as RoundedBox
from .shapes import SpatialCapsule as Capsule
from .shapes import Sphere

__all__ = [
    "Capsule",
    "Contact",
    "RigidBody",
    "RoundedBox",
    "Score",
    "Sphere",
    "SphereRobot",
]
