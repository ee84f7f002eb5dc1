"""How one product is bounded, and the penalties that stand in for a bound: one small file for each."""

from .augmented_lagrangian import AugmentedLagrangian
from .elastic import Elastic
from .fischer_burmeister import FischerBurmeister
from .kadrani import Kadrani
from .kanzow_schwartz import KanzowSchwartz
from .lin_fukushima import LinFukushima
from .penalty import Penalty
from .protocol import KeepsBounds, KeepsMultipliers, ObjectiveTerm, Relaxation
from .registry import as_relaxation
from .scholtes import Scholtes
from .smoothed_minimum import ChenHarkerKanzowSmale
from .steffensen_ulbrich import SteffensenUlbrich
from .two_sided import TwoSided

__all__ = [
    "AugmentedLagrangian",
    "ChenHarkerKanzowSmale",
    "Elastic",
    "FischerBurmeister",
    "Kadrani",
    "KanzowSchwartz",
    "KeepsBounds",
    "KeepsMultipliers",
    "LinFukushima",
    "ObjectiveTerm",
    "Penalty",
    "Relaxation",
    "Scholtes",
    "SteffensenUlbrich",
    "TwoSided",
    "as_relaxation",
]
