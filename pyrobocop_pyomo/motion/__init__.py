"""Rigid bodies in motion: where they are between the nodes, and the proof that they keep their distances."""

from .bodies import Body
from .motion import Motion, motion_of
from .safety_report import PairSafety, SafetyReport
from .verification import verify_clearance

__all__ = [
    "Body",
    "Motion",
    "PairSafety",
    "SafetyReport",
    "motion_of",
    "verify_clearance",
]
