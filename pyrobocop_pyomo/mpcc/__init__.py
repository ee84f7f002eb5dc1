"""Complementarity problems as numbers: branches, stationarity, and the certificate by linear programs."""

from .active_set import Certificate
from .stationarity import Multipliers, Stationarity

__all__ = ["Certificate", "Multipliers", "Stationarity"]
