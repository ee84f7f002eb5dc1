"""Reusable models of contact mechanics."""

from . import planar, spatial
from .contact_laws import CoulombFriction, CoulombSlip, HardWall, SoftWall
from .planar_pushing import SquareSlider
from .signal_laws import AbsoluteValue, SignalLaw, Step

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
