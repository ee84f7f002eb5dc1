"""The many ways of writing pairs in Pyomo, each in a problem whose solution is known by inspection."""

from __future__ import annotations

from typing import Any

import pyomo.environ as pyo
from pyomo import mpec

from pyrobocop_pyomo.complementarity import Complementarity, complements

from .entries import MpccProblem

FORMS = frozenset({"statement"})
CONVEX = frozenset({"statement", "convex"})
INSPECTION = "by inspection"


def _largest_in_disk() -> Any:
    """Maximisation: of the points of a disk around (3, 2) on the axes the one with the largest x + 2 y."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(0, None), initialize=1), pyo.Var(bounds=(0, None), initialize=1)
    m.reach = pyo.Objective(expr=m.x + 2 * m.y, sense=pyo.maximize)
    m.disk = pyo.Constraint(expr=(m.x - 3) ** 2 + (m.y - 2) ** 2 <= 10)
    m.either = Complementarity(expr=complements(m.x >= 0, m.y >= 0))
    return m


def _named_expressions() -> Any:
    """Gap and force are named expressions: a block on a spring pressed against a wall at 1."""
    m = pyo.ConcreteModel()
    m.push, m.place = pyo.Var(bounds=(0, 10), initialize=1), pyo.Var(initialize=0)
    m.gap = pyo.Expression(expr=1 - m.place)
    m.force = pyo.Expression(expr=m.push - 2 * m.place)
    m.cost = pyo.Objective(expr=(m.force - 3) ** 2 + 0.1 * m.push**2)
    m.contact = Complementarity(expr=complements(m.gap >= 0, m.force >= 0))
    return m


def _mutable_bounds() -> Any:
    """Bounds that are parameters, on variables and in relations, to both directions."""
    m = pyo.ConcreteModel()
    m.low, m.high = pyo.Param(initialize=1.0, mutable=True), pyo.Param(initialize=4.0, mutable=True)
    m.x = pyo.Var(bounds=(m.low, None), initialize=2)
    m.y = pyo.Var(bounds=(None, m.high), initialize=2)
    m.low.set_value(2.0)
    m.cost = pyo.Objective(expr=(m.x - 5) ** 2 + (m.y - 2) ** 2)
    m.either = Complementarity(expr=complements(m.x >= m.low, m.y <= m.high))
    return m


def _plain_variables() -> Any:
    """The sides are variables alone; the bound of the second is chosen, since it has two."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(1, None), initialize=2), pyo.Var(bounds=(0, 3), initialize=1)
    m.cost = pyo.Objective(expr=(m.x - 2) ** 2 + (m.y - 1) ** 2)
    m.either = Complementarity(expr=complements(m.x, m.y, second_bound="upper"))
    return m


def _two_sided_relation() -> Any:
    """A relation with variables on both sides: x <= y against z >= 1."""
    m = pyo.ConcreteModel()
    m.x, m.y, m.z = pyo.Var(initialize=0), pyo.Var(initialize=1), pyo.Var(initialize=2)
    m.cost = pyo.Objective(expr=(m.x - 1) ** 2 + (m.y - 2) ** 2 + (m.z - 2) ** 2)
    m.either = Complementarity(expr=complements(m.x <= m.y, m.z >= 1))
    return m


def _blocks() -> Any:
    """Pairs indexed inside indexed blocks, of both packages: three springs, each with two stops."""
    m = pyo.ConcreteModel()
    m.pull = pyo.Var(bounds=(0, 10), initialize=0)
    m.spring = pyo.Block([1, 2, 3])
    for stiffness, b in m.spring.items():
        b.place = pyo.Var(initialize=0)
        b.force = pyo.Var(["near", "far"], bounds=(0, None), initialize=0)
        b.balance = pyo.Constraint(expr=stiffness * b.place == m.pull - b.force["near"] - b.force["far"])
        b.near = Complementarity(expr=complements(b.force["near"] >= 0, 1 + 0.5 * b.force["near"] - b.place >= 0))
        b.far = mpec.Complementarity(expr=mpec.complements(b.force["far"] >= 0, 3 - b.place >= 0))
    m.cost = pyo.Objective(expr=sum((b.place - 2) ** 2 for b in m.spring.values()) + 0.01 * m.pull**2)
    return m


def _complementarity_list() -> Any:
    """A list of pyomo.mpec: a saturated chain, each the positive part of the one before minus one."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(5), bounds=(0, None), initialize=1)
    m.x[0].setub(10)
    m.chain = mpec.ComplementarityList()
    for i in range(1, 5):
        m.chain.add(mpec.complements(m.x[i] >= 0, m.x[i] - m.x[i - 1] + 1 >= 0))
    m.cost = pyo.Objective(expr=(sum(m.x.values()) - 5) ** 2 + 0.1 * m.x[0])
    return m


def _fixed_side() -> Any:
    """Some sides hold a variable that is fixed: it is zero once and positive once."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var([1, 2, 3], bounds=(0, None), initialize=1)
    m.y = pyo.Var([1, 2, 3], bounds=(0, None), initialize=1)
    m.x[1].fix(0)
    m.y[2].fix(1.5)
    m.cost = pyo.Objective(expr=sum((m.x[i] - 1) ** 2 + (m.y[i] - i) ** 2 for i in m.x))
    m.either = Complementarity([1, 2, 3], rule=lambda m, i: complements(m.x[i] >= 0, m.y[i] >= 0))
    return m


def _without_objective() -> Any:
    """No objective at all: the linear complementarity problem of Murty's exponential example, four rows."""
    m = pyo.ConcreteModel()
    m.z = pyo.Var(range(4), bounds=(0, None), initialize=0)
    m.pairs = Complementarity(
        range(4), rule=lambda m, i: complements(m.z[i] + 2 * sum(m.z[j] for j in range(i + 1, 4)) - 1 >= 0, m.z[i] >= 0)
    )
    return m


def _from_pyomo_kkt() -> Any:
    """The optimality conditions of a follower, written by Pyomo's own transformation ``core.kkt``."""
    follower = pyo.ConcreteModel()
    follower.x, follower.y = pyo.Var(initialize=5), pyo.Var(initialize=1)
    follower.cost = pyo.Objective(expr=(follower.y - 1) ** 2 - 1.5 * follower.x * follower.y)
    follower.rows = pyo.ConstraintList()
    x, y = follower.x, follower.y
    for row in (3 * x - y >= 3, -x + 0.5 * y >= -4, -x - y >= -7, y >= 0):
        follower.rows.add(row)
    pyo.TransformationFactory("core.kkt").apply_to(follower, parameterize_wrt=[x])
    follower.leader = pyo.Objective(expr=(x - 5) ** 2 + (2 * y + 1) ** 2)
    follower.positive = pyo.Constraint(expr=x >= 0)
    return follower


def _units_of_thousands() -> Any:
    """Sides that differ by nine orders of magnitude: a valve in pascal and cubic metres per second."""
    m = pyo.ConcreteModel()
    m.pressure, m.flow = pyo.Var(bounds=(0, 1e6), initialize=1e5), pyo.Var(bounds=(0, 1e-2), initialize=1e-3)
    m.cost = pyo.Objective(expr=(m.pressure / 1e5 - 2) ** 2 + (m.flow * 1e3 - 1) ** 2)
    m.valve = Complementarity(expr=complements(m.pressure >= 0, m.flow >= 0))
    return m


def _nonlinear_sides() -> Any:
    """Both sides are nonlinear expressions: outside a disk, or on its boundary, against a hyperbola."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(0.1, 5), initialize=1), pyo.Var(bounds=(0.1, 5), initialize=1)
    m.cost = pyo.Objective(expr=(m.x - 1) ** 2 + (m.y - 2) ** 2)
    m.either = Complementarity(expr=complements(m.x**2 + m.y**2 >= 4, m.x * m.y <= 3))
    return m


PROBLEMS = (
    MpccProblem("largest in a disk", _largest_in_disk, 6.0, tags=CONVEX | {"maximise"}, source=INSPECTION,
                solution={"x": 0, "y": 3}, notes="A local solution at x = 3 + sqrt(6) reaches 5.449."),
    MpccProblem("named expressions", _named_expressions, 25 / 11, tags=CONVEX, source=INSPECTION),
    MpccProblem("mutable bounds", _mutable_bounds, 4.0, tags=CONVEX, source=INSPECTION, solution={"x": 5, "y": 4}),
    MpccProblem("plain variables", _plain_variables, 1.0, tags=CONVEX, source=INSPECTION, solution={"x": 1, "y": 1}),
    MpccProblem("relation of variables", _two_sided_relation, 0.5, tags=CONVEX, source=INSPECTION,
                solution={"x": 1.5, "y": 1.5, "z": 2}),
    MpccProblem("springs in blocks", _blocks, 0.7815652, tags=CONVEX, source="written for this catalogue"),
    MpccProblem("chain in a list", _complementarity_list, 0.2663889, tags=CONVEX, source="written for this catalogue"),
    MpccProblem("fixed sides", _fixed_side, 3.25, tags=CONVEX | {"fixed"}, source=INSPECTION),
    MpccProblem("murty without objective", _without_objective, 0.0, tags=CONVEX | {"linear", "no objective"},
                source="Murty, Linear Complementarity, Linear and Nonlinear Programming (1988)"),
    MpccProblem("bard1 by core.kkt", _from_pyomo_kkt, 17.0, tags=FORMS | {"bilevel", "convex"},
                source="MacMPEC (S. Leyffer), bard1", solution={"x": 1, "y": 0}),
    MpccProblem("nine orders of magnitude", _units_of_thousands, 1.0, tags=CONVEX | {"scaling"}, source=INSPECTION),
    MpccProblem("nonlinear sides", _nonlinear_sides, 9 - 4 * 5**0.5, tags=FORMS, source=INSPECTION,
                solution={"x": 2 / 5**0.5, "y": 4 / 5**0.5}),
)  # fmt: skip
