"""Plan motion through contact and around obstacles, as ordinary Pyomo models."""

from pyrobocop_pyomo._version import __version__
from pyrobocop_pyomo.complementarity import (
    Complementarity,
    Fixed,
    FollowBarrier,
    Geometric,
    Penalty,
    PerElement,
    PerPair,
    Scholtes,
    active_pairs,
    complements,
)
from pyrobocop_pyomo.errors import PyRobocopError, SolveFailed
from pyrobocop_pyomo.mechanics import SquareSlider
from pyrobocop_pyomo.numerics import CollocationScheme, Grid, Mesh, find_scheme, gauss_legendre, radau
from pyrobocop_pyomo.phases import (
    Algebraic,
    Control,
    Duration,
    Parameter,
    PhaseBlock,
    State,
    Verification,
)
from pyrobocop_pyomo.plotting import draw_planar_pushing
from pyrobocop_pyomo.trajectories import Trajectory

__all__ = [
    "Algebraic",
    "CollocationScheme",
    "Complementarity",
    "Control",
    "Duration",
    "Fixed",
    "FollowBarrier",
    "Geometric",
    "Grid",
    "Mesh",
    "Parameter",
    "Penalty",
    "PerElement",
    "PerPair",
    "PhaseBlock",
    "PyRobocopError",
    "Scholtes",
    "SolveFailed",
    "SquareSlider",
    "State",
    "Trajectory",
    "Verification",
    "__version__",
    "active_pairs",
    "complements",
    "draw_planar_pushing",
    "find_scheme",
    "gauss_legendre",
    "radau",
]
