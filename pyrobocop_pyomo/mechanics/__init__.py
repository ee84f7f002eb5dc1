"""Reusable models of contact mechanics."""

from . import planar, spatial
from .planar_pushing import SquareSlider
from .signal_laws import AbsoluteValue, CoulombFriction, CoulombSlip, HardWall, SignalLaw, SoftWall, Step

__all__ = [
    "AbsoluteValue",
    "CoulombFriction",
    "CoulombSlip",
    "HardWall",
    "SignalLaw",
    "SoftWall",
    "SquareSlider",
    "Step",
    "planar",
    "spatial",
]
