"""Reusable models of contact mechanics."""

from . import planar, spatial
from .contact_laws import CoulombFriction, CoulombSlip, HardWall, SoftWall
from .nonsmooth_functions import AbsoluteValue, Step
from .planar_pushing import SquareSlider
from .signal_laws import SignalLaw

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
