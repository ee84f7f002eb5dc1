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
from pyrobocop_pyomo.continuous import dae_trajectory
from pyrobocop_pyomo.errors import PyRobocopError, SolveFailed
from pyrobocop_pyomo.mechanics import SquareSlider
from pyrobocop_pyomo.numerics import Grid, Mesh, Scheme, explicit, find_scheme, gauss_legendre, lobatto, radau
from pyrobocop_pyomo.phases import (
    Algebraic,
    Control,
    Duration,
    Parameter,
    PhaseBlock,
    State,
    Verification,
)
from pyrobocop_pyomo.plotting import draw_linkage, draw_planar_pushing
from pyrobocop_pyomo.solving import (
    Quality,
    Route,
    SolveResult,
    StopReason,
    available_routes,
    configure_ipopt_executable,
    solve,
)
from pyrobocop_pyomo.trajectories import Trajectory

__all__ = [
    "Algebraic",
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
    "Quality",
    "Route",
    "Scheme",
    "Scholtes",
    "SolveFailed",
    "SolveResult",
    "SquareSlider",
    "State",
    "StopReason",
    "Trajectory",
    "Verification",
    "__version__",
    "active_pairs",
    "available_routes",
    "complements",
    "dae_trajectory",
    "draw_linkage",
    "draw_planar_pushing",
    "explicit",
    "find_scheme",
    "gauss_legendre",
    "lobatto",
    "radau",
    "solve",
]

# Pyomo's own interfaces then find an executable that sits in this Python environment; nothing is started.
configure_ipopt_executable()
