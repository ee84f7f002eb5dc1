"""Rigid bodies, disc robots, contact between them and its physical score, in the plane."""

from .planar_bodies import DiscRobot, GroundFriction, ViscousDrag
from .planar_bodies import PlanarBody as RigidBody
from .planar_contacts import PlanarContact as Contact
from .planar_score import PlanarScore as Score
from .planar_shapes import Capsule, Disc, RoundedBox

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
