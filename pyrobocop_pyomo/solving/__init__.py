"""Solving one model with complementarity: the procedure and its result."""

from .pair_report import ActiveSide, PairReport
from .persistent_nlp import PersistentNLP
from .solve_result import Quality, SolveResult, StopReason
from .step import Step
from .strategies import Strategy

__all__ = [
    "ActiveSide",
    "PairReport",
    "PersistentNLP",
    "Quality",
    "SolveResult",
    "Step",
    "StopReason",
    "Strategy",
]
