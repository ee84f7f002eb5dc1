"""Studies around a solve: many starts or data, paths of data, sensitivity, refinement, sequences, receding horizons.

`multistart`, `homotopy`, `sweep`, `solve_files`, `solve_sequences` and `solve_refined` give a `StudyResult`: a sequence
of outcomes that prints as a table. Its members mean the same in all of them:

* ``best``: the outcome that answers the study; its point is the one on the model;
* ``result``: the `SolveResult` of that outcome;
* ``reached``: whether the goal was reached, at a point that is optimal and, where there are obstacles, safe;
* ``remaining``: what a time limit or Ctrl-C left undone;
* ``to_pandas()`` and ``table()``: a row per outcome, with the same columns behind those that are the study's own.

``time_limit`` is for the whole study.
"""

from pyrobocop_pyomo.solving import PersistentNLP

from .case_solver import SweepOutcome
from .homotopy import HomotopyResult, HomotopyStep, homotopy
from .multistart import MultistartResult, StartOutcome, multistart
from .outcomes import Outcome, StudyResult
from .receding_horizon import HorizonStep, RecedingHorizon
from .refinement import RefinedResult, RefinementEnd, RefinementStep, solve_refined
from .sensitivity import Sensitivity, sensitivity
from .sequences import SequenceOutcome, SequenceRanking, mode_sequences, solve_sequences
from .solve_files import solve_files
from .sweep import SweepResult
from .sweep_cases import SweepCase

__all__ = [
    "HomotopyResult",
    "HomotopyStep",
    "HorizonStep",
    "MultistartResult",
    "Outcome",
    "PersistentNLP",
    "RecedingHorizon",
    "RefinedResult",
    "RefinementEnd",
    "RefinementStep",
    "Sensitivity",
    "SequenceOutcome",
    "SequenceRanking",
    "StartOutcome",
    "StudyResult",
    "SweepCase",
    "SweepOutcome",
    "SweepResult",
    "homotopy",
    "mode_sequences",
    "multistart",
    "sensitivity",
    "solve_files",
    "solve_refined",
    "solve_sequences",
]
