"""Plan motion through contact and around obstacles, as ordinary Pyomo models.

What nearly every script uses is here. The rest is in namespaces: `drawing`, `engines`, `errors`, `estimation`,
`formulations`, `geometry`, `groupings`, `initial_guesses`, `ipopt`, `learning`, `mechanics`, `parking`, `relaxations`,
`results`, `robots`, `schedules`, `schemes` and `studies`.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from pyrobocop_pyomo import errors, groupings, relaxations, schedules, schemes, solvers_on_demand
from pyrobocop_pyomo._version import __version__
from pyrobocop_pyomo.complementarity import Complementarity, active_pairs, complements, either_zero
from pyrobocop_pyomo.continuous import dae_trajectory
from pyrobocop_pyomo.links import Link
from pyrobocop_pyomo.modeling import similar_names as _similar_names
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
    label_measurements,
    phases_of,
    remesh_phases,
)
from pyrobocop_pyomo.trajectories import Trajectory, join_trajectories

if TYPE_CHECKING:
    from pyrobocop_pyomo import (
        drawing,
        engines,
        estimation,
        formulations,
        geometry,
        initial_guesses,
        ipopt,
        learning,
        mechanics,
        parking,
        results,
        robots,
        studies,
        teams,
    )
    from pyrobocop_pyomo.diagnosis import diagnose
    from pyrobocop_pyomo.distributed.agents import Agent, KeepApart, Shared
    from pyrobocop_pyomo.distributed.team import Team
    from pyrobocop_pyomo.estimation.estimate import estimate
    from pyrobocop_pyomo.geometry import Polytope, planar_pose, spatial_pose
    from pyrobocop_pyomo.motion import Body, TablePath
    from pyrobocop_pyomo.obstacles import Containment, FreeClearance, ObstacleAvoidanceBlock, verify_motion
    from pyrobocop_pyomo.planning import solve
    from pyrobocop_pyomo.problem_classes import from_pyrobocop, solution_arrays
    from pyrobocop_pyomo.solving import Quality, SolveResult, StopReason, Strategy
    from pyrobocop_pyomo.studies.sweep import sweep

# What states a problem is loaded at once; what reads obstacles, solves, studies or draws, when it is first used: a
# program that only builds models starts in half the time. The solvers' names are known to Pyomo all the same.
solvers_on_demand.register()
_NAMESPACES_ON_DEMAND = {
    "drawing",
    "engines",
    "estimation",
    "formulations",
    "geometry",
    "initial_guesses",
    "ipopt",
    "learning",
    "mechanics",
    "parking",
    "results",
    "robots",
    "studies",
    "teams",
}
_HOMES_ON_DEMAND = {
    "Agent": "distributed.agents",
    "Body": "motion",
    "Containment": "obstacles",
    "FreeClearance": "obstacles",
    "KeepApart": "distributed.agents",
    "ObstacleAvoidanceBlock": "obstacles",
    "Polytope": "geometry",
    "Quality": "solving",
    "Shared": "distributed.agents",
    "SolveResult": "solving",
    "StopReason": "solving",
    "Strategy": "solving",
    "TablePath": "motion",
    "Team": "distributed.team",
    "diagnose": "diagnosis",
    "estimate": "estimation.estimate",
    "from_pyrobocop": "problem_classes",
    "planar_pose": "geometry",
    "solution_arrays": "problem_classes",
    "solve": "planning",
    "spatial_pose": "geometry",
    "sweep": "studies.sweep",
    "verify_motion": "obstacles",
}

__all__ = [
    "Agent",
    "Algebraic",
    "Body",
    "Complementarity",
    "Containment",
    "Control",
    "Duration",
    "FreeClearance",
    "Function",
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
    "StopReason",
    "Strategy",
    "Table",
    "TablePath",
    "Team",
    "Trajectory",
    "__version__",
    "active_pairs",
    "array",
    "complements",
    "dae_trajectory",
    "diagnose",
    "drawing",
    "either_zero",
    "engines",
    "errors",
    "estimate",
    "estimation",
    "formulations",
    "from_pyrobocop",
    "geometry",
    "groupings",
    "initial_guesses",
    "ipopt",
    "join_trajectories",
    "label_measurements",
    "learning",
    "mechanics",
    "parking",
    "phases_of",
    "planar_pose",
    "relaxations",
    "remesh_phases",
    "results",
    "robots",
    "schedules",
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
        return import_module(f"{__name__}.{name}")
    if name not in _HOMES_ON_DEMAND:
        where = _similar_names.where_it_is(name, sys.modules[__name__], __all__)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{where}")
    found = globals()[name] = getattr(import_module(f"{__name__}.{_HOMES_ON_DEMAND[name]}"), name)
    return found


def __dir__() -> list[str]:
    """List the public names only, so that completion does not offer the folders of the implementation."""
    return sorted(__all__)
