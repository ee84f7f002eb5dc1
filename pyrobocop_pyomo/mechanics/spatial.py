"""Rigid bodies, sphere robots, contact between them and its physical score, in space."""

from .spatial_bodies import SpatialBody as RigidBody
from .spatial_bodies import SphereRobot
from .spatial_contacts import SpatialContact as Contact
from .spatial_score import SpatialScore as Score
from .spatial_shapes import SpatialBox as RoundedBox
from .spatial_shapes import SpatialCapsule as Capsule
from .spatial_shapes import Sphere

__all__ = [
    "Capsule",
    "Contact",
    "RigidBody",
    "RoundedBox",
    "Score",
    "Sphere",
    "SphereRobot",
]
