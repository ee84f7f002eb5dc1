"""Plan motion through contact and around obstacles, as ordinary Pyomo models.

What nearly every script uses is here. The rest is in namespaces: `drawing`, `engines`, `errors`, `formulations`,
`geometry`, `groupings`, `initial_guesses`, `ipopt`, `mechanics`, `relaxations`, `results`, `schedules`, `schemes` and
`studies`.
"""

from pyrobocop_pyomo import (
    drawing,
    engines,
    errors,
    formulations,
    geometry,
    groupings,
    initial_guesses,
    ipopt,
    mechanics,
    relaxations,
    results,
    schedules,
    schemes,
    studies,
    teams,
)
from pyrobocop_pyomo._version import __version__
from pyrobocop_pyomo.complementarity import Complementarity, active_pairs, complements, either_zero
from pyrobocop_pyomo.continuous import dae_trajectory
from pyrobocop_pyomo.diagnosis import diagnose
from pyrobocop_pyomo.distributed.agents import Agent, KeepApart, Shared
from pyrobocop_pyomo.distributed.team import Team
from pyrobocop_pyomo.geometry import Polytope, planar_pose, spatial_pose
from pyrobocop_pyomo.motion import Body
from pyrobocop_pyomo.obstacles import Containment, ObstacleAvoidanceBlock
from pyrobocop_pyomo.phases import (
    Algebraic,
    Control,
    Duration,
    Link,
    Parameter,
    PhaseBlock,
    Start,
    State,
    label_measurements,
    phases_of,
)
from pyrobocop_pyomo.planning import solve
from pyrobocop_pyomo.solving import Quality, SolveResult, StopReason, Strategy
from pyrobocop_pyomo.trajectories import Trajectory, join_trajectories

__all__ = [
    "Agent",
    "Algebraic",
    "Body",
    "Complementarity",
    "Containment",
    "Control",
    "Duration",
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
    "Team",
    "Trajectory",
    "__version__",
    "active_pairs",
    "complements",
    "dae_trajectory",
    "diagnose",
    "drawing",
    "either_zero",
    "engines",
    "errors",
    "formulations",
    "geometry",
    "groupings",
    "initial_guesses",
    "ipopt",
    "join_trajectories",
    "label_measurements",
    "mechanics",
    "phases_of",
    "planar_pose",
    "relaxations",
    "results",
    "schedules",
    "schemes",
    "solve",
    "spatial_pose",
    "studies",
    "teams",
]


def __dir__() -> list[str]:
    """List the public names only, so that completion does not offer the folders of the implementation."""
    return sorted(__all__)
