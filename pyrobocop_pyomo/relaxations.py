"""How complementarity pairs are relaxed, grouped into rows, and driven to zero: values of three options, and protocols.

::

    pyrobocop_pyomo.solve(
        model, strategies=pyrobocop_pyomo.Strategy(relaxation=pyrobocop_pyomo.relaxations.FischerBurmeister())
    )

The names of this module are values of a strategy's `relaxation=`, of its `grouping=` (which products share one row) and
of its `schedule=` (how the relaxation parameter delta shrinks), and the protocols for your own.
"""

from pyrobocop_pyomo.complementarity import (
    Crossed,
    FischerBurmeister,
    Fixed,
    FollowBarrier,
    Geometric,
    Grouping,
    Relaxation,
    Schedule,
    Scholtes,
    Superlinear,
)

__all__ = [
    "Crossed",
    "FischerBurmeister",
    "Fixed",
    "FollowBarrier",
    "Geometric",
    "Grouping",
    "Relaxation",
    "Schedule",
    "Scholtes",
    "Superlinear",
]
