"""Solving models with complementarity, and with phases: the procedure, its result, and what is built on it."""

from .kept_model import KeptModel
from .mode_sequences import mode_sequences
from .procedure import solve
from .receding_horizon import HorizonStep, RecedingHorizon
from .refined_result import RefinedResult, RefinementEnd, RefinementStep
from .refinement import solve_refined
from .sequence_ranking import SequenceOutcome, SequenceRanking
from .sequence_solver import solve_sequences
from .solve_result import Quality, SolveResult, StopReason
from .step import Step

__all__ = [
    "HorizonStep",
    "KeptModel",
    "Quality",
    "RecedingHorizon",
    "RefinedResult",
    "RefinementEnd",
    "RefinementStep",
    "SequenceOutcome",
    "SequenceRanking",
    "SolveResult",
    "Step",
    "StopReason",
    "mode_sequences",
    "solve",
    "solve_refined",
    "solve_sequences",
]
