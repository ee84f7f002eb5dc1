"""Solving one model with complementarity: the procedure and its result."""

from .pair_report import ActiveSide, PairReport
from .persistent_program import KeptModel
from .rungs import Rung
from .solve_result import Quality, SolveResult, StopReason
from .step import Step

__all__ = [
    "ActiveSide",
    "KeptModel",
    "PairReport",
    "Quality",
    "Rung",
    "SolveResult",
    "Step",
    "StopReason",
]
