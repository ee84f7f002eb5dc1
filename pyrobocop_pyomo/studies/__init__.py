"""Studies around a solve: many starts, paths of data, sensitivity, mesh refinement, sequences, receding horizons."""

from .homotopy import HomotopyResult, HomotopyStep, homotopy
from .mode_sequences import mode_sequences
from .multistart import MultistartResult, StartOutcome, multistart
from .receding_horizon import HorizonStep, RecedingHorizon
from .refined_result import RefinedResult, RefinementEnd, RefinementStep
from .refinement import solve_refined
from .sensitivity import Sensitivity, sensitivity
from .sequence_ranking import SequenceOutcome, SequenceRanking
from .sequence_solver import solve_sequences

__all__ = [
    "HomotopyResult",
    "HomotopyStep",
    "HorizonStep",
    "MultistartResult",
    "RecedingHorizon",
    "RefinedResult",
    "RefinementEnd",
    "RefinementStep",
    "Sensitivity",
    "SequenceOutcome",
    "SequenceRanking",
    "StartOutcome",
    "homotopy",
    "mode_sequences",
    "multistart",
    "sensitivity",
    "solve_refined",
    "solve_sequences",
]
