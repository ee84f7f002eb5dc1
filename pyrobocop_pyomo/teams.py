"""How the agents of a team come to agree, where they live, and what comes back.

The methods are values of `method=`, with the schedules of their rounds; the engines, where agents live and solves of a
study are done, are values of `engine=`. A `Checkpoint` is a file to go on from.
"""

from pyrobocop_pyomo.distributed.closing import Closing
from pyrobocop_pyomo.distributed.method import Hub, Sova
from pyrobocop_pyomo.distributed.rounds import BarrierPath, Round, TargetedPenalties
from pyrobocop_pyomo.distributed.team_horizon import TeamHorizon
from pyrobocop_pyomo.distributed.team_result import Checkpoint, TeamResult
from pyrobocop_pyomo.execution.engine import Engine
from pyrobocop_pyomo.execution.engines import ExecutorEngine, SerialEngine
from pyrobocop_pyomo.execution.process_engine import ProcessEngine

__all__ = [
    "BarrierPath",
    "Checkpoint",
    "Closing",
    "Engine",
    "ExecutorEngine",
    "Hub",
    "ProcessEngine",
    "Round",
    "SerialEngine",
    "Sova",
    "TargetedPenalties",
    "TeamHorizon",
    "TeamResult",
]
