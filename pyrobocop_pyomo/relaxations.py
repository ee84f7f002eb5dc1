"""How complementarity pairs are relaxed, grouped into rows, and driven to zero: values of three options, and protocols.

::

    pyrobocop_pyomo.solve(model, relaxation=pyrobocop_pyomo.relaxations.FischerBurmeister())

The names of this module are values of `relaxation=`, of `grouping=` (which products share one row) and of `schedule=`
(how the relaxation parameter delta shrinks), and the protocols for your own.
"""

from pyrobocop_pyomo.complementarity import (
    AllPairs,
    AugmentedLagrangian,
    BarrierSchedule,
    ChenHarkerKanzowSmale,
    Crossed,
    Elastic,
    FischerBurmeister,
    Fixed,
    FollowBarrier,
    Geometric,
    Grouping,
    Kadrani,
    KanzowSchwartz,
    KeepsBounds,
    KeepsMultipliers,
    LinFukushima,
    ObjectiveTerm,
    Penalty,
    PerElement,
    PerPair,
    PerPhase,
    Relaxation,
    Schedule,
    Scholtes,
    SteffensenUlbrich,
    Superlinear,
    TwoSided,
)

__all__ = [
    "AllPairs",
    "AugmentedLagrangian",
    "BarrierSchedule",
    "ChenHarkerKanzowSmale",
    "Crossed",
    "Elastic",
    "FischerBurmeister",
    "Fixed",
    "FollowBarrier",
    "Geometric",
    "Grouping",
    "Kadrani",
    "KanzowSchwartz",
    "KeepsBounds",
    "KeepsMultipliers",
    "LinFukushima",
    "ObjectiveTerm",
    "Penalty",
    "PerElement",
    "PerPair",
    "PerPhase",
    "Relaxation",
    "Schedule",
    "Scholtes",
    "SteffensenUlbrich",
    "Superlinear",
    "TwoSided",
]
