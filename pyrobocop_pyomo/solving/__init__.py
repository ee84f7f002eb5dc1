"""Solving models with complementarity, and with phases: the procedure, its result, and what is built on it."""

from .homotopy import HomotopyResult, HomotopyStep, homotopy
from .kept_model import KeptModel
from .mode_sequences import mode_sequences
from .mpcc_solver import Mpcc
from .multistart import MultistartResult, StartOutcome, multistart
from .pair_report import ActiveSide, PairReport
from .procedure import solve
from .receding_horizon import HorizonStep, RecedingHorizon
from .refined_result import RefinedResult, RefinementEnd, RefinementStep
from .refinement import solve_refined
from .rungs import Rung
from .sensitivity import Sensitivity, sensitivity
from .sequence_ranking import SequenceOutcome, SequenceRanking
from .sequence_solver import solve_sequences
from .solve_result import Quality, SolveResult, StopReason
from .step import Step

__all__ = [
    "ActiveSide",
    "HomotopyResult",
    "HomotopyStep",
    "HorizonStep",
    "KeptModel",
    "Mpcc",
    "MultistartResult",
    "PairReport",
    "Quality",
    "RecedingHorizon",
    "RefinedResult",
    "RefinementEnd",
    "RefinementStep",
    "Rung",
    "Sensitivity",
    "SequenceOutcome",
    "SequenceRanking",
    "SolveResult",
    "StartOutcome",
    "Step",
    "StopReason",
    "homotopy",
    "mode_sequences",
    "multistart",
    "sensitivity",
    "solve",
    "solve_refined",
    "solve_sequences",
]
