"""How one product is bounded, and the penalties that stand in for a bound: one small file for each."""

from .penalty import Penalty
from .protocol import KeepsBounds, KeepsMultipliers, ObjectiveTerm, Relaxation
from .scholtes import Scholtes, ScholtesEquality
from .words import as_relaxation

__all__ = [
    "KeepsBounds",
    "KeepsMultipliers",
    "ObjectiveTerm",
    "Penalty",
    "Relaxation",
    "Scholtes",
    "ScholtesEquality",
    "as_relaxation",
]
