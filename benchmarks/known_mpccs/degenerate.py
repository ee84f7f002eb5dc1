"""Problems where multipliers do not exist, are not unique or have the wrong sign, although the solution is obvious."""

from __future__ import annotations

from typing import Any

import pyomo.environ as pyo

from .academic import MACMPEC, plane
from .entries import MpccProblem, state_pairs

DEGENERATE = frozenset({"academic", "degenerate", "biactive"})


def _ralph1() -> Any:
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(0, None), initialize=0), pyo.Var(bounds=(0, None), initialize=0)
    m.cost = pyo.Objective(expr=2 * m.x - m.y)
    state_pairs(m, [(m.y, m.y - m.x)])
    return m


def _ralph2() -> Any:
    return plane(lambda x, y: x**2 + y**2 - 4 * x * y, (1, 1))


def _scholtes4() -> Any:
    m = plane(lambda x, y: x + y, (0, 1))
    m.z = pyo.Var(initialize=0)
    m.cost.set_value(m.x + m.y - m.z)
    m.first = pyo.Constraint(expr=-4 * m.x + m.z <= 0)
    m.second = pyo.Constraint(expr=-4 * m.y + m.z <= 0)
    return m


def _square_at_least_one() -> Any:
    m = plane(lambda x, y: x + y, (1, 0))
    m.square = pyo.Constraint(expr=m.y**2 >= 1)
    return m


def _from_the_corner() -> Any:
    return plane(lambda x, y: (x - 1) ** 2 + (y - 1) ** 2)


def _corner_pulls() -> Any:
    """The corner is C-stationary, both axes lead out of it, and the way between them costs."""
    return plane(lambda x, y: 0.5 * (x**2 + y**2) - x - y + 3 * x * y, (0.5, 0.5))


def _stated_twice() -> Any:
    m = plane(lambda x, y: (x - 2) ** 2 + (y - 1) ** 2, (1, 1))
    m.again = pyo.Block()
    state_pairs(m.again, [(m.y, m.x), (2 * m.x, 3 * m.y)])
    return m


def _three_sides() -> Any:
    """At most one of three is positive: three pairs, of which any two leave the third to follow or not."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var([1, 2, 3], bounds=(0, None), initialize=1)
    m.cost = pyo.Objective(expr=sum((m.x[i] - i) ** 2 for i in m.x))
    state_pairs(m, [(m.x[1], m.x[2]), (m.x[2], m.x[3]), (m.x[3], m.x[1])])
    return m


def _flat_side() -> Any:
    """One side is a square: its gradient vanishes where it is zero."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(0, None), initialize=1), pyo.Var(initialize=2)
    m.cost = pyo.Objective(expr=(m.x - 1) ** 2 + (m.y - 0.1) ** 2)
    state_pairs(m, [(m.x, m.y**2)])
    return m


def _dempe() -> Any:
    m = pyo.ConcreteModel()
    m.x, m.z = pyo.Var(initialize=1), pyo.Var(initialize=0.5)
    m.w = pyo.Var(bounds=(0, None), initialize=1)
    m.cost = pyo.Objective(expr=(m.x - 3.5) ** 2 + (m.z + 4) ** 2)
    m.stationary = pyo.Constraint(expr=m.z - 3 + 2 * m.z * m.w == 0)
    state_pairs(m, [(m.x - m.z**2, m.w)])
    return m


def _only_the_corner() -> Any:
    """The corner is the only feasible point: x + y <= 0 with x, y >= 0."""
    m = plane(lambda x, y: -x - 2 * y, (1, 1))
    m.row = pyo.Constraint(expr=m.x + m.y <= 0)
    return m


def _two_corners() -> Any:
    """Two pairs whose branches interact: which side of the first pays depends on the second."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var([1, 2, 3, 4], bounds=(0, None), initialize=0.5)
    x = m.x
    m.cost = pyo.Objective(expr=x[1] + x[2] + (x[3] - 1) ** 2 + (x[4] - 1) ** 2 + x[3] * x[4] - 2 * x[1] * x[3])
    m.limit = pyo.Constraint(expr=x[1] <= 0.25)
    state_pairs(m, [(x[1], x[2]), (x[3], x[4])])
    return m


def _redundant_rows() -> Any:
    """The same kink with its rows stated three times over: no multiplier is unique."""
    m = _ralph1()
    m.cost.set_value((m.x - 1) ** 2 + m.y**2)
    m.above = pyo.Constraint(range(3), rule=lambda m, i: (i + 1) * (m.y - m.x) >= 0)
    m.positive = pyo.Constraint(range(3), rule=lambda m, i: (i + 2) * m.y >= 0)
    return m


def _nothing_to_decide() -> Any:
    """No objective wish at all: every complementary point is a solution."""
    m = pyo.ConcreteModel()
    index = range(1, 11)
    m.x, m.y = pyo.Var(index, bounds=(0, None), initialize=1), pyo.Var(index, bounds=(0, None), initialize=1)
    m.cost = pyo.Objective(expr=0 * m.x[1])
    m.total = pyo.Constraint(expr=sum(m.x[i] + m.y[i] for i in index) == 10)
    state_pairs(m, [(m.x[i], m.y[i]) for i in index])
    return m


def _kojima_shindo() -> Any:
    """A complementarity problem with two solutions; the one with the larger x4 is wanted."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var([1, 2, 3, 4], bounds=(0, None), initialize=1)
    a, b, c, d = (m.x[i] for i in (1, 2, 3, 4))
    m.cost = pyo.Objective(expr=-d)
    sides = (
        3 * a**2 + 2 * a * b + 2 * b**2 + c + 3 * d - 6,
        2 * a**2 + a + b**2 + 10 * c + 2 * d - 2,
        3 * a**2 + a * b + 2 * b**2 + 2 * c + 9 * d - 9,
        a**2 + 3 * b**2 + 2 * c + 3 * d - 3,
    )
    state_pairs(m, [(m.x[i], side) for i, side in enumerate(sides, start=1)])
    return m


PROBLEMS = (
    MpccProblem("ralph1", _ralph1, 0.0, source=MACMPEC.format("ralph1"), solution={"x": 0, "y": 0},
                tags=DEGENERATE | {"convex", "linear", "b-not-s"},
                notes="B-stationary but not S: the product form has no multipliers."),
    MpccProblem("ralph2", _ralph2, 0.0, source=MACMPEC.format("ralph2"), tags=DEGENERATE, solution={"x": 0, "y": 0},
                notes="Not convex, but strongly convex on each axis; the product form is unbounded for x y > 0."),
    MpccProblem("scholtes4", _scholtes4, 0.0, source=f"{MACMPEC.format('scholtes4')}; Scheel & Scholtes, "
                "Math. Oper. Res. 25 (2000), doi:10.1287/moor.25.1.1.15213", solution={"x": 0, "y": 0, "z": 0},
                tags=DEGENERATE | {"convex", "linear", "b-not-s"}, notes="B- and M-stationary but not S."),
    MpccProblem("square at least one", _square_at_least_one, 1.0, solution={"x": 0, "y": 1},
                source="Fletcher, Leyffer, Ralph & Scholtes, SIAM J. Optim. 17 (2006), doi:10.1137/S1052623402407382",
                tags=frozenset({"academic"}), notes="Linearised at (1, 0) the product form is inconsistent."),
    MpccProblem("start in the corner", _from_the_corner, 1.0, tags=DEGENERATE | {"convex"} - {"biactive"},
                source="by inspection", notes="Starts at a C-stationary point that symmetry keeps attractive."),
    MpccProblem("corner pulls", _corner_pulls, -0.5, tags=DEGENERATE - {"biactive"}, source="by inspection: (1, 0)",
                notes="Both branches are convex; their union has a C-stationary point in the corner."),
    MpccProblem("stated twice", _stated_twice, 1.0, tags=DEGENERATE | {"convex"}, solution={"x": 2, "y": 0},
                source="by inspection", notes="The same pair three times: linear independence fails everywhere."),
    MpccProblem("three sides", _three_sides, 5.0, tags=DEGENERATE | {"convex"},
                solution={"x[1]": 0, "x[2]": 0, "x[3]": 3}, source="by inspection"),
    MpccProblem("flat side", _flat_side, 0.01, tags=DEGENERATE - {"biactive"}, solution={"x": 1, "y": 0},
                source="by inspection", notes="The gradient of y^2 vanishes at the solution."),
    MpccProblem("dempe", _dempe, 28.25, source=MACMPEC.format("dempe"), tags=DEGENERATE | {"not attained"},
                notes="An infimum: z tends to 0 and the multiplier w to infinity; reached to any accuracy. z = 1 is "
                "an inflection of the cost along the boundary, and stationary."),
    MpccProblem("only the corner", _only_the_corner, 0.0, tags=DEGENERATE | {"convex", "linear"},
                solution={"x": 0, "y": 0}, source="by inspection", notes="One feasible point, hence no interior."),
    MpccProblem("two corners", _two_corners, 0.6875, tags=DEGENERATE - {"biactive"}, source="enumerated by hand",
                notes="x1 pays only together with x3: 0.25 - 0.5 x3 + (x3 - 1)^2 + 1 at x3 = 1.25."),
    MpccProblem("redundant rows", _redundant_rows, 0.5, tags=DEGENERATE - {"biactive"} | {"convex"},
                solution={"x": 0.5, "y": 0.5}, source="jr1 of MacMPEC with repeated rows"),
    MpccProblem("nothing to decide", _nothing_to_decide, 0.0, tags=DEGENERATE - {"biactive"} | {"convex", "linear"},
                source="by inspection", notes="A continuum of solutions."),
    MpccProblem("kojima-shindo", _kojima_shindo, -0.5, tags=DEGENERATE,
                solution={"x[1]": 1.5**0.5, "x[2]": 0, "x[3]": 0, "x[4]": 0.5},
                source="Kojima & Shindo, J. Oper. Res. Soc. Japan 29 (1986), doi:10.15807/jorsj.29.352",
                notes="The other solution (1, 0, 3, 0) is strictly complementary; this one is biactive in the third."),
)  # fmt: skip
