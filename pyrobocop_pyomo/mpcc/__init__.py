"""Complementarity problems as numbers: branches, stationarity, and the certificate by linear programs."""

from .active_set import Certificate
from .multipliers import Multipliers, Stationarity

__all__ = ["Certificate", "Multipliers", "Stationarity"]
