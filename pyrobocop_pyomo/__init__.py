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
    from pyrobocop_pyomo import ipopt, mechanics, scenes, studies, teams
    from pyrobocop_pyomo.contrib import estimation
    from pyrobocop_pyomo.contrib.estimation.estimate import estimate
    from pyrobocop_pyomo.contrib.estimation.measurements import label_measurements
    from pyrobocop_pyomo.contrib.pyrobocop_classes import from_pyrobocop, solution_arrays
    from pyrobocop_pyomo.diagnosis import diagnose
    from pyrobocop_pyomo.distributed.agents import Agent, KeepApart, Shared
    from pyrobocop_pyomo.distributed.team import Team
    from pyrobocop_pyomo.geometry import Polytope, planar_pose, spatial_pose
    from pyrobocop_pyomo.motion import Body, TablePath
    from pyrobocop_pyomo.mpcc import Certificate, Stationarity
    from pyrobocop_pyomo.numerics.gaussian_process import GaussianProcessMean
    from pyrobocop_pyomo.obstacles import Containment, ObstacleAvoidanceBlock, verify_motion
    from pyrobocop_pyomo.phases import Verification
    from pyrobocop_pyomo.planning import solve
    from pyrobocop_pyomo.solving import Quality, SolveResult, StopReason, Strategy
    from pyrobocop_pyomo.studies.sweep import sweep

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
    "motion": "Body TablePath",
    "mpcc": "Certificate Stationarity",
    "numerics.gaussian_process": "GaussianProcessMean",
    "obstacles": "Containment ObstacleAvoidanceBlock verify_motion",
    "phases": "Verification",
    "planning": "solve",
    "solving": "Quality SolveResult StopReason Strategy",
    "studies.sweep": "sweep",
}
_HOMES_ON_DEMAND = {name: home for home, names in _NAMES_ON_DEMAND.items() for name in names.split()}

_removed = errors.removed_names(
    __name__,
    {
        "benchmarks/solve_files.py, which solves problem files, and model.write()": "files",
        "nothing: results give its objects": "ActiveSide PairReport SafetyReport Diagnosis",
    },
)

__all__ = [
    "Agent",
    "Algebraic",
    "Body",
    "Certificate",
    "Complementarity",
    "Containment",
    "Control",
    "Duration",
    "Function",
    "GaussianProcessMean",
    "JoinedTrajectory",
    "KeepApart",
    "Link",
    "ObstacleAvoidanceBlock",
    "Parameter",
    "PhaseBlock",
    "Polytope",
    "Quality",
    "Shared",
    "SolveResult",
    "Start",
    "State",
    "Stationarity",
    "StopReason",
    "Strategy",
    "Table",
    "TablePath",
    "Team",
    "Trajectory",
    "Verification",
    "__version__",
    "active_pairs",
    "array",
    "complements",
    "dae_trajectory",
    "diagnose",
    "either_zero",
    "errors",
    "estimate",
    "estimation",
    "from_pyrobocop",
    "ipopt",
    "join_trajectories",
    "label_measurements",
    "mechanics",
    "phases_of",
    "planar_pose",
    "relaxations",
    "remesh_phases",
    "scenes",
    "schemes",
    "solution_arrays",
    "solve",
    "spatial_pose",
    "studies",
    "sweep",
    "teams",
    "verify_motion",
]


def __getattr__(name: str) -> Any:
    """A public name that is loaded on demand."""
    if name in _NAMESPACES_ON_DEMAND:
        return import_module(f"{__name__}.contrib.{name}" if name == "estimation" else f"{__name__}.{name}")
    if name not in _HOMES_ON_DEMAND:
        _removed(name, _keywords.where_it_is(name, sys.modules[__name__], __all__))
    found = globals()[name] = getattr(import_module(f"{__name__}.{_HOMES_ON_DEMAND[name]}"), name)
    return found


def __dir__() -> list[str]:
    """List the public names only, so that completion does not offer the folders of the implementation."""
    return sorted(__all__)
