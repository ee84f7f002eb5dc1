"""How the agents of a team come to agree: values of `method=`, the schedules of their rounds, and what comes back."""

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

__all__ = [
    "BalancedPenalties",
    "BarrierPath",
    "BarrierRounds",
    "ConsensusResiduals",
    "ConstantBarrier",
    "ConstantPenalties",
    "Coordination",
    "GrowingPenalties",
    "Hub",
    "LocalProblem",
    "MergedModel",
    "Method",
    "Order",
    "PenaltyMatrix",
    "PenaltyRestart",
    "PenaltyRounds",
    "Physics",
    "PlanScore",
    "PlanningStep",
    "ProblemFacts",
    "ProblemSpec",
    "QuantityFacts",
    "Report",
    "Round",
    "Sova",
    "TargetedPenalties",
    "TeamHorizon",
    "TeamResult",
    "TeamState",
    "merge_agents",
]
