"""Reusable models of contact mechanics."""

from . import planar, spatial
from .contact_laws import CoulombFriction, CoulombSlip, HardWall, PointContact, SoftWall
from .nonsmooth_functions import AbsoluteValue, Maximum, Minimum, Saturation, Sign, Step
from .planar_pushing import SquareSlider
from .signal_laws import SignalLaw

__all__ = [
    "AbsoluteValue",
    "CoulombFriction",
    "CoulombSlip",
    "HardWall",
    "Maximum",
    "Minimum",
    "PointContact",
    "Saturation",
    "Sign",
    "SignalLaw",
    "SoftWall",
    "SquareSlider",
    "Step",
    "planar",
    "spatial",
]
