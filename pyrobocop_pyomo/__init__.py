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
from pyrobocop_pyomo.diagnosis import Diagnosis, diagnose
from pyrobocop_pyomo.errors import PyRobocopError, SimulationFailed, SolveFailed
from pyrobocop_pyomo.ipopt import Route, available_routes, configure_ipopt_executable
from pyrobocop_pyomo.mechanics import SquareSlider
from pyrobocop_pyomo.numerics import Grid, Mesh, Scheme, explicit, find_scheme, gauss_legendre, lobatto, radau
from pyrobocop_pyomo.phases import (
    Algebraic,
    Control,
    Duration,
    Link,
    Parameter,
    PhaseBlock,
    Start,
    State,
    Verification,
    label_measurements,
)
from pyrobocop_pyomo.plotting import draw_linkage, draw_planar_pushing
from pyrobocop_pyomo.solving import (
    Quality,
    RecedingHorizon,
    RefinedResult,
    RefinementEnd,
    SequenceRanking,
    SolveResult,
    StopReason,
    mode_sequences,
    solve,
    solve_refined,
    solve_sequences,
)
from pyrobocop_pyomo.trajectories import JoinedTrajectory, Trajectory, join_trajectories

__all__ = [
    "Algebraic",
    "Complementarity",
    "Control",
    "Diagnosis",
    "Duration",
    "Fixed",
    "FollowBarrier",
    "Geometric",
    "Grid",
    "JoinedTrajectory",
    "Link",
    "Mesh",
    "Parameter",
    "Penalty",
    "PerElement",
    "PerPair",
    "PhaseBlock",
    "PyRobocopError",
    "Quality",
    "RecedingHorizon",
    "RefinedResult",
    "RefinementEnd",
    "Route",
    "Scheme",
    "Scholtes",
    "SequenceRanking",
    "SimulationFailed",
    "SolveFailed",
    "SolveResult",
    "SquareSlider",
    "Start",
    "State",
    "StopReason",
    "Trajectory",
    "Verification",
    "__version__",
    "active_pairs",
    "available_routes",
    "complements",
    "dae_trajectory",
    "diagnose",
    "draw_linkage",
    "draw_planar_pushing",
    "explicit",
    "find_scheme",
    "gauss_legendre",
    "join_trajectories",
    "label_measurements",
    "lobatto",
    "mode_sequences",
    "radau",
    "solve",
    "solve_refined",
    "solve_sequences",
]

# Pyomo's own interfaces then find an executable that sits in this Python environment; nothing is started.
configure_ipopt_executable()
