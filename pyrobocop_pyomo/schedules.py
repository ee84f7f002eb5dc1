"""How the relaxation parameter delta shrinks: values of `schedule=`."""

from pyrobocop_pyomo.complementarity import Fixed, FollowBarrier, Geometric, Schedule, Superlinear

__all__ = [
    "Fixed",
    "FollowBarrier",
    "Geometric",
    "Schedule",
    "Superlinear",
]
