"""Robots that other programs describe, as bodies of a scene."""

from .urdf import DescribedRobot, from_urdf

__all__ = ["DescribedRobot", "from_urdf"]
