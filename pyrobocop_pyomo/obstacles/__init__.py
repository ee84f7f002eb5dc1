"""Obstacles: bodies, how they move between the nodes, and the proof that they keep clear of each other."""

from .bodies import Body
from .motion import Motion, motion_of
from .safety_report import PairSafety, SafetyReport
from .verification import verify_clearance

__all__ = ["Body", "Motion", "PairSafety", "SafetyReport", "motion_of", "verify_clearance"]
