"""No point satisfies these; a method that reports one as solved is wrong."""

from __future__ import annotations

from functools import partial
from typing import Any

import pyomo.environ as pyo

from .academic import plane
from .entries import MpccProblem, state_follower, state_pairs

INFEASIBLE = frozenset({"infeasible"})
CONVEX = frozenset({"infeasible", "convex"})


def _both_at_least(least: float) -> Any:
    m = plane(lambda x, y: x + y, (1, 1))
    m.first, m.second = pyo.Constraint(expr=m.x >= least), pyo.Constraint(expr=m.y >= least)
    return m


def _sum_and_difference() -> Any:
    """x + y = 2 and x - y = 0 meet at (1, 1), off the axes."""
    m = plane(lambda x, y: x**2 + y**2, (2, 0))
    m.sum, m.difference = pyo.Constraint(expr=m.x + m.y == 2), pyo.Constraint(expr=m.x == m.y)
    return m


def _disk_off_the_axes() -> Any:
    m = plane(lambda x, y: x + 2 * y, (1, 1))
    m.disk = pyo.Constraint(expr=(m.x - 2) ** 2 + (m.y - 2) ** 2 <= 1)
    return m


def _lcp() -> Any:
    """A linear complementarity problem whose rows can be met, but never complementarily."""
    m = pyo.ConcreteModel()
    m.z = pyo.Var([1, 2], bounds=(0, None), initialize=1)
    m.cost = pyo.Objective(expr=m.z[1] + m.z[2])
    # The first row makes z1 positive, hence z1 = 1 + z2, and then the second is -1.
    state_pairs(m, [(m.z[1], m.z[1] - m.z[2] - 1), (m.z[2], m.z[1] - m.z[2] - 2)])
    return m


def _odd_cycle() -> Any:
    """Of neighbours in a ring of five one is zero; the sum of all cannot be three when each is at most one."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(5), bounds=(0, 1), initialize=0.5)
    m.cost = pyo.Objective(expr=m.x[0])
    m.total = pyo.Constraint(expr=sum(m.x.values()) >= 2.1)
    state_pairs(m, [(m.x[i], m.x[(i + 1) % 5]) for i in range(5)])
    return m


def _follower_refuses() -> Any:
    """The leader demands what the follower never chooses."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(0, 10), initialize=1), pyo.Var(bounds=(0, None), initialize=1)
    m.cost = pyo.Objective(expr=m.x)
    state_follower(m, (m.y - 2) ** 2, [m.y], [m.x + 3 - m.y, m.y])
    m.demand = pyo.Constraint(expr=m.y >= 3)
    return m


def _contradicting_bounds() -> Any:
    """Already without its pairs there is no point."""
    m = plane(lambda x, y: x + y, (1, 1))
    m.row = pyo.Constraint(expr=m.x + m.y <= -1)
    return m


PROBLEMS = (
    MpccProblem("both at least one", partial(_both_at_least, 1), None, False, tags=CONVEX),
    MpccProblem("sum and difference", _sum_and_difference, None, False, tags=CONVEX),
    MpccProblem("both at least 0.01", partial(_both_at_least, 0.01), None, False, tags=CONVEX | {"scaling"},
                notes="With products below 1e-4 only the natural residual min(a, b) tells."),
    MpccProblem("disk off the axes", _disk_off_the_axes, None, False, tags=CONVEX),
    MpccProblem("impossible lcp", _lcp, None, False, tags=CONVEX),
    MpccProblem("ring of five", _odd_cycle, None, False, tags=CONVEX | {"linear"},
                notes="Feasible without its pairs; every single pair can be met."),
    MpccProblem("the follower refuses", _follower_refuses, None, False, tags=CONVEX | {"bilevel"}),
    MpccProblem("contradicting rows", _contradicting_bounds, None, False, tags=CONVEX),
)  # fmt: skip
