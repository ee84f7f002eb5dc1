"""Reusable models of contact mechanics."""

from pyrobocop_pyomo.errors import removed_names

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

__getattr__ = removed_names(
    __name__,
    {
        "it as Maximum(s - upper, 0) less Maximum(lower - s, 0)": "DeadZone",
        "SquareSlider has one; of another outline, state the velocity in the ode": "LimitSurface",
        "score.misses('strict') or score.misses('practical')": "ScoreLimits",
        "a law of your own (docs/how-to/contact-laws), or CoulombFriction along each direction": "SlidingFriction",
        "give CoulombFriction a rule as its coefficient": "StribeckFriction",
    },
)
