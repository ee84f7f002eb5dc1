"""Plan motion through contact and around obstacles, as ordinary Pyomo models.

What nearly every script uses is here. The rest is in namespaces: `errors`, `estimation`, `ipopt`, `mechanics`,
`relaxations`, `scenes`, `schemes`, `studies` and `teams`.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from pyrobocop_pyomo import errors, relaxations, schemes, solvers_on_demand
from pyrobocop_pyomo._version import __version__
from pyrobocop_pyomo.complementarity import Complementarity, active_pairs, complements, either_zero
from pyrobocop_pyomo.continuous import dae_trajectory
from pyrobocop_pyomo.links import Link
from pyrobocop_pyomo.modeling import keywords as _keywords
from pyrobocop_pyomo.modeling.expression_arrays import array
from pyrobocop_pyomo.modeling.functions import Function
from pyrobocop_pyomo.numerics.tables import Table
from pyrobocop_pyomo.phases import (
    Algebraic,
    Control,
    Duration,
    Parameter,
    PhaseBlock,
    Start,
    State,
    phases_of,
    remesh_phases,
)
from pyrobocop_pyomo.trajectories import JoinedTrajectory, Trajectory, join_trajectories

if TYPE_CHECKING:
    from pyrobocop_pyomo import ipopt as ipopt
    from pyrobocop_pyomo import mechanics as mechanics
    from pyrobocop_pyomo import scenes as scenes
    from pyrobocop_pyomo import studies as studies
    from pyrobocop_pyomo import teams as teams
    from pyrobocop_pyomo.contrib import estimation as estimation
    from pyrobocop_pyomo.contrib.estimation.estimate import estimate as estimate
    from pyrobocop_pyomo.contrib.estimation.measurements import label_measurements as label_measurements
    from pyrobocop_pyomo.contrib.pyrobocop_classes import from_pyrobocop as from_pyrobocop
    from pyrobocop_pyomo.contrib.pyrobocop_classes import solution_arrays as solution_arrays
    from pyrobocop_pyomo.diagnosis import diagnose as diagnose
    from pyrobocop_pyomo.distributed.agents import Agent as Agent
    from pyrobocop_pyomo.distributed.agents import KeepApart as KeepApart
    from pyrobocop_pyomo.distributed.agents import Shared as Shared
    from pyrobocop_pyomo.distributed.team import Team as Team
    from pyrobocop_pyomo.geometry import Polytope as Polytope
    from pyrobocop_pyomo.geometry import planar_pose as planar_pose
    from pyrobocop_pyomo.geometry import spatial_pose as spatial_pose
    from pyrobocop_pyomo.motion import Body as Body
    from pyrobocop_pyomo.mpcc import Certificate as Certificate
    from pyrobocop_pyomo.mpcc import Stationarity as Stationarity
    from pyrobocop_pyomo.obstacles import Containment as Containment
    from pyrobocop_pyomo.obstacles import ObstacleAvoidanceBlock as ObstacleAvoidanceBlock
    from pyrobocop_pyomo.obstacles import verify_motion as verify_motion
    from pyrobocop_pyomo.phases import Verification as Verification
    from pyrobocop_pyomo.planning import solve as solve
    from pyrobocop_pyomo.solving import Quality as Quality
    from pyrobocop_pyomo.solving import SolveResult as SolveResult
    from pyrobocop_pyomo.solving import StopReason as StopReason
    from pyrobocop_pyomo.solving import Strategy as Strategy
    from pyrobocop_pyomo.studies.sweep import sweep as sweep

# What states a problem is loaded at once; what reads obstacles, solves, studies or draws, when it is first used: a
# program that only builds models starts in half the time. The solvers' names are known to Pyomo all the same.
solvers_on_demand.register()
_NAMESPACES_ON_DEMAND = ("estimation", "ipopt", "mechanics", "scenes", "studies", "teams")
_NAMES_ON_DEMAND = {
    "contrib.estimation.estimate": "estimate",
    "contrib.estimation.measurements": "label_measurements",
    "contrib.pyrobocop_classes": "from_pyrobocop solution_arrays",
    "diagnosis": "diagnose",
    "distributed.agents": "Agent KeepApart Shared",
    "distributed.team": "Team",
    "geometry": "Polytope planar_pose spatial_pose",
    "motion": "Body",
    "mpcc": "Certificate Stationarity",
    "obstacles": "Containment ObstacleAvoidanceBlock verify_motion",
    "phases": "Verification",
    "planning": "solve",
    "solving": "Quality SolveResult StopReason Strategy",
    "studies.sweep": "sweep",
}
_HOMES_ON_DEMAND = {name: home for home, names in _NAMES_ON_DEMAND.items() for name in names.split()}

__all__ = [
    "Algebraic",
    "Complementarity",
    "Control",
    "Duration",
    "Function",
    "JoinedTrajectory",
    "Link",
    "Parameter",
    "PhaseBlock",
    "Start",
    "State",
    "Table",
    "Trajectory",
    "__version__",
    "active_pairs",
    "array",
    "complements",
    "dae_trajectory",
    "either_zero",
    "errors",
    "join_trajectories",
    "phases_of",
    "relaxations",
    "remesh_phases",
    "schemes",
    *_HOMES_ON_DEMAND,
    *_NAMESPACES_ON_DEMAND,
]


def __getattr__(name: str) -> Any:
    """A public name that is loaded on demand."""
    if name in _NAMESPACES_ON_DEMAND:
        return import_module(f"{__name__}.contrib.{name}" if name == "estimation" else f"{__name__}.{name}")
    if name not in _HOMES_ON_DEMAND:
        where = _keywords.where_it_is(name, sys.modules[__name__], __all__)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{where}")
    found = globals()[name] = getattr(import_module(f"{__name__}.{_HOMES_ON_DEMAND[name]}"), name)
    return found


def __dir__() -> list[str]:
    """List the public names only, so that completion does not offer the folders of the implementation."""
    return sorted(__all__)
