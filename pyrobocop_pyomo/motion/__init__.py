"""Rigid bodies in motion: their poses between the nodes, and the proof that they keep their distances."""

from .bodies import Body
from .clearance_proof import verify_clearance
from .motion import Motion, motion_of
from .safety_report import BodyPairSafety, SafetyReport

__all__ = ["Body", "BodyPairSafety", "Motion", "SafetyReport", "motion_of", "verify_clearance"]
