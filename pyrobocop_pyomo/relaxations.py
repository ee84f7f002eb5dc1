"""How a complementarity pair is relaxed: values of `relaxation=`, and protocols for relaxations of your own.

::

    pyrobocop_pyomo.solve(model, relaxation=pyrobocop_pyomo.relaxations.FischerBurmeister())
"""

from pyrobocop_pyomo.complementarity import (
    AugmentedLagrangian,
    ChenHarkerKanzowSmale,
    Elastic,
    FischerBurmeister,
    Kadrani,
    KanzowSchwartz,
    KeepsBounds,
    KeepsMultipliers,
    LinFukushima,
    ObjectiveTerm,
    Penalty,
    Relaxation,
    Scholtes,
    SteffensenUlbrich,
    TwoSided,
)

__all__ = [
    "AugmentedLagrangian",
    "ChenHarkerKanzowSmale",
    "Elastic",
    "FischerBurmeister",
    "Kadrani",
    "KanzowSchwartz",
    "KeepsBounds",
    "KeepsMultipliers",
    "LinFukushima",
    "ObjectiveTerm",
    "Penalty",
    "Relaxation",
    "Scholtes",
    "SteffensenUlbrich",
    "TwoSided",
]
