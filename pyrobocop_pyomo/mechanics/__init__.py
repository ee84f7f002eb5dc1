"""Reusable models of contact mechanics."""

from . import planar, spatial
from .friction import CoulombFriction, CoulombSlip, StribeckFriction
from .limit_surfaces import LimitSurface, SlidingFriction
from .nonsmooth_functions import AbsoluteValue, DeadZone, Maximum, Minimum, Saturation
from .physical_score import PhysicalScore, ScoreLimits
from .planar_pushing import SquareSlider
from .signal_laws import SignalLaw
from .switches import Sign, Step
from .walls import HardWall, PointContact, SoftWall

__all__ = [
    "AbsoluteValue",
    "CoulombFriction",
    "CoulombSlip",
    "DeadZone",
    "HardWall",
    "LimitSurface",
    "Maximum",
    "Minimum",
    "PhysicalScore",
    "PointContact",
    "Saturation",
    "ScoreLimits",
    "Sign",
    "SignalLaw",
    "SlidingFriction",
    "SoftWall",
    "SquareSlider",
    "Step",
    "StribeckFriction",
    "planar",
    "spatial",
]
