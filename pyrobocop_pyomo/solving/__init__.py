"""Solving one model with complementarity: the procedure and its result."""

from pyrobocop_pyomo.diagnosis.least_violation import LeastViolation, Obstruction
from pyrobocop_pyomo.programs.automatic_scaling import ScalingRecord

from .iterates import Iterate, Quality, Standing, StopReason
from .result_text import ActiveSide, PairReport
from .solve_result import SolveResult
from .strategies import Strategy
from .violations import Violation

__all__ = [
    "ActiveSide", "Iterate", "LeastViolation", "Obstruction", "PairReport", "Quality",
    "ScalingRecord", "SolveResult", "Standing", "StopReason", "Strategy", "Violation",
]  # fmt: skip
