"""Obstacles: bodies, how they move between the nodes, and the proof that they keep clear of each other."""

from .bodies import Body
from .motion import Motion, motion_of

__all__ = ["Body", "Motion", "motion_of"]
