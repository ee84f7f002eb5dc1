"""Rigid bodies in motion: their poses between the nodes, and the proof that they keep their distances."""

from .bodies import Body
from .clearance_proof import verify_clearance
from .motion import Motion, motion_of
from .safety_report import BodyPairSafety, SafetyReport
from .table_paths import TablePath

__all__ = ["Body", "BodyPairSafety", "Motion", "SafetyReport", "TablePath", "motion_of", "verify_clearance"]
