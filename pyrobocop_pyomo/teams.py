"""How the agents of a team come to agree: values of `method=`, the schedules of their rounds, and what comes back."""

from pyrobocop_pyomo.distributed.coordination import Coordination, Physics, TeamState
from pyrobocop_pyomo.distributed.hub_method import Hub
from pyrobocop_pyomo.distributed.local_problem import LocalProblem, ProblemSpec
from pyrobocop_pyomo.distributed.merging import MergedModel, merge_agents
from pyrobocop_pyomo.distributed.messages import Order, PenaltyMatrix, ProblemFacts, QuantityFacts, Report
from pyrobocop_pyomo.distributed.rounds import PlanScore, Round
from pyrobocop_pyomo.distributed.sova import Sova
from pyrobocop_pyomo.distributed.spread import Spread
from pyrobocop_pyomo.distributed.team import Method
from pyrobocop_pyomo.distributed.team_horizon import TeamHorizon, TeamTick
from pyrobocop_pyomo.distributed.team_result import TeamResult
from pyrobocop_pyomo.distributed.team_schedules import (
    BalancedPenalties,
    BarrierPath,
    BarrierRounds,
    ConstantBarrier,
    ConstantPenalties,
    GrowingPenalties,
    PenaltyRounds,
    Reopening,
    TargetedPenalties,
)

__all__ = [
    "BalancedPenalties",
    "BarrierPath",
    "BarrierRounds",
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
    "PenaltyRounds",
    "Physics",
    "PlanScore",
    "ProblemFacts",
    "ProblemSpec",
    "QuantityFacts",
    "Reopening",
    "Report",
    "Round",
    "Sova",
    "Spread",
    "TargetedPenalties",
    "TeamHorizon",
    "TeamResult",
    "TeamState",
    "TeamTick",
    "merge_agents",
]
