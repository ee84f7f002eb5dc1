"""How one product is bounded, and the penalties that stand in for a bound: one small file for each."""

from .elastic import Elastic
from .fischer_burmeister import FischerBurmeister
from .kanzow_schwartz import KanzowSchwartz
from .penalty import Penalty
from .protocol import ObjectiveTerm, Relaxation
from .registry import as_relaxation
from .scholtes import Scholtes
from .smoothed_minimum import ChenHarkerKanzowSmale
from .steffensen_ulbrich import SteffensenUlbrich

__all__ = [
    "ChenHarkerKanzowSmale",
    "Elastic",
    "FischerBurmeister",
    "KanzowSchwartz",
    "ObjectiveTerm",
    "Penalty",
    "Relaxation",
    "Scholtes",
    "SteffensenUlbrich",
    "as_relaxation",
]
