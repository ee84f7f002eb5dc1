"""How the agents of a team come to agree, where they live, and what comes back.

The methods are values of `method=`, with the schedules of their rounds; the engines, where agents live and solves of a
study are done, are values of `engine=`. A `Checkpoint` is a file to go on from.
"""

from pyrobocop_pyomo.distributed.checkpoint import Checkpoint, fingerprint
from pyrobocop_pyomo.distributed.closing import ClosedPlan, Closing
from pyrobocop_pyomo.distributed.consensus_residuals import ConsensusResiduals
from pyrobocop_pyomo.distributed.coordination import Coordination, Physics, TeamState
from pyrobocop_pyomo.distributed.hub_method import Hub
from pyrobocop_pyomo.distributed.local_problem import LocalProblem, ProblemSpec
from pyrobocop_pyomo.distributed.merging import MergedModel, merge_agents
from pyrobocop_pyomo.distributed.messages import Order, PenaltyMatrix, ProblemFacts, QuantityFacts, Report
from pyrobocop_pyomo.distributed.rounds import PlanScore, Round
from pyrobocop_pyomo.distributed.sova import Sova
from pyrobocop_pyomo.distributed.team import Method
from pyrobocop_pyomo.distributed.team_horizon import PlanningStep, TeamHorizon
from pyrobocop_pyomo.distributed.team_result import TeamResult
from pyrobocop_pyomo.distributed.team_schedules import (
    BalancedPenalties,
    BarrierPath,
    BarrierRounds,
    ConstantBarrier,
    ConstantPenalties,
    GrowingPenalties,
    PenaltyRestart,
    PenaltyRounds,
    TargetedPenalties,
)
from pyrobocop_pyomo.execution.dask_engine import DaskEngine
from pyrobocop_pyomo.execution.engine import AgentFailure, Engine
from pyrobocop_pyomo.execution.engines import find_engine
from pyrobocop_pyomo.execution.mpi_engine import MpiEngine
from pyrobocop_pyomo.execution.process_engine import ProcessEngine
from pyrobocop_pyomo.execution.serial_engine import SerialEngine
from pyrobocop_pyomo.execution.simulated_network import SimulatedNetwork
from pyrobocop_pyomo.execution.worker_host import HostedProblem, HostedSpec

__all__ = [
    "AgentFailure",
    "BalancedPenalties",
    "BarrierPath",
    "BarrierRounds",
    "Checkpoint",
    "ClosedPlan",
    "Closing",
    "ConsensusResiduals",
    "ConstantBarrier",
    "ConstantPenalties",
    "Coordination",
    "DaskEngine",
    "Engine",
    "GrowingPenalties",
    "HostedProblem",
    "HostedSpec",
    "Hub",
    "LocalProblem",
    "MergedModel",
    "Method",
    "MpiEngine",
    "Order",
    "PenaltyMatrix",
    "PenaltyRestart",
    "PenaltyRounds",
    "Physics",
    "PlanScore",
    "PlanningStep",
    "ProblemFacts",
    "ProblemSpec",
    "ProcessEngine",
    "QuantityFacts",
    "Report",
    "Round",
    "SerialEngine",
    "SimulatedNetwork",
    "Sova",
    "TargetedPenalties",
    "TeamHorizon",
    "TeamResult",
    "TeamState",
    "find_engine",
    "fingerprint",
    "merge_agents",
]
