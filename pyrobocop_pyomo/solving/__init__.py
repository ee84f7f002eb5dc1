"""Solving one model with complementarity: the procedure and its result."""

from .automatic_scaling import ScalingRecord
from .iterates import Iterate, Quality, Standing, StopReason
from .pair_report import ActiveSide, PairReport
from .persistent_nlp import PersistentNLP
from .solve_result import SolveResult
from .strategies import Strategy

__all__ = [
    "ActiveSide", "Iterate", "PairReport", "PersistentNLP", "Quality", "ScalingRecord", "SolveResult", "Standing",
    "StopReason", "Strategy",
]  # fmt: skip
