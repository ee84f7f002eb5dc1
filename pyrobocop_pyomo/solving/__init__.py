"""Solving one model with complementarity: the procedure and its result."""

from .automatic_scaling import ScalingRecord
from .iterates import Iterate, Quality, Standing, StopReason
from .least_violation import LeastViolation, Obstruction, Relief
from .pair_report import ActiveSide, PairReport
from .persistent_nlp import PersistentNLP
from .solve_result import SolveResult
from .strategies import Strategy
from .violations import Violation

__all__ = [
    "ActiveSide", "Iterate", "LeastViolation", "Obstruction", "PairReport", "PersistentNLP", "Quality", "Relief",
    "ScalingRecord", "SolveResult", "Standing", "StopReason", "Strategy", "Violation",
]  # fmt: skip
