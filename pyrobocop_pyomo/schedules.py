"""How the relaxation parameter delta shrinks: values of `schedule=`."""

from pyrobocop_pyomo.complementarity import BarrierSchedule, Fixed, FollowBarrier, Geometric, Schedule, Superlinear

__all__ = ["BarrierSchedule", "Fixed", "FollowBarrier", "Geometric", "Schedule", "Superlinear"]
