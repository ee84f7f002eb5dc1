"""Bilevel programs with a convex follower, through the optimality conditions of the follower."""

from __future__ import annotations

from functools import partial
from typing import Any

import pyomo.environ as pyo

from .academic import MACMPEC
from .entries import MpccProblem, state_follower, state_pairs

HANDBOOK = "Floudas et al., Handbook of Test Problems (1999), ch. 9, doi:10.1007/978-1-4757-3040-1"
LINEAR = frozenset({"bilevel", "linear", "convex"})


def _nonnegative(leader: int, followers: int, start: float = 1.0) -> tuple[Any, Any, Any]:
    """A leader's x and a follower's y, all of them nonnegative."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(1, leader + 1), bounds=(0, None), initialize=start)
    m.y = pyo.Var(range(1, followers + 1), bounds=(0, None), initialize=start)
    return m, m.x, m.y


def _clark_westerberg_1990() -> Any:
    m, x, y = _nonnegative(1, 2)
    m.cost = pyo.Objective(expr=-x[1] - 3 * y[1] + 2 * y[2])
    rows = [
        16 + 2 * x[1] - y[1] - 4 * y[2],
        48 - 8 * x[1] - 3 * y[1] + 2 * y[2],
        -12 + 2 * x[1] - y[1] + 3 * y[2],
        4 - y[1],
        y[1],
        y[2],
    ]
    state_follower(m, -y[1], [y[1], y[2]], rows)
    return m


def _liu_hart() -> Any:
    m, x, y = _nonnegative(1, 1)
    m.cost = pyo.Objective(expr=-x[1] - 3 * y[1])
    rows = [3 + x[1] - y[1], 12 - x[1] - 2 * y[1], 12 - 4 * x[1] + y[1], y[1]]
    state_follower(m, y[1] + 0, [y[1]], rows)
    return m


def _candler_townsley() -> Any:
    m, x, y = _nonnegative(2, 3)
    m.cost = pyo.Objective(expr=-8 * x[1] - 4 * x[2] + 4 * y[1] - 40 * y[2] - 4 * y[3])
    rows = [
        1 + y[1] - y[2] - y[3],
        1 - 2 * x[1] + y[1] - 2 * y[2] + 0.5 * y[3],
        1 - 2 * x[2] - 2 * y[1] + y[2] + 0.5 * y[3],
        *y.values(),
    ]
    state_follower(m, x[1] + 2 * x[2] + y[1] + y[2] + 2 * y[3], list(y.values()), rows)
    return m


def _clark_westerberg_1988() -> Any:
    m, x, y = _nonnegative(1, 1)
    m.cost = pyo.Objective(expr=x[1] - 4 * y[1])
    rows = [2 * x[1] - y[1], 108 - 2 * x[1] - 5 * y[1], -4 - 2 * x[1] + 3 * y[1], y[1]]
    state_follower(m, y[1] + 0, [y[1]], rows)
    return m


def _bard_1991() -> Any:
    m, x, y = _nonnegative(1, 2)
    m.cost = pyo.Objective(expr=-x[1] + 10 * y[1] - y[2])
    rows = [1 - x[1] - y[1], 1 - x[1] - y[2], 1 - y[1] - y[2], y[1], y[2]]
    state_follower(m, -y[1] - y[2], [y[1], y[2]], rows)
    return m


def _polygon(cost: Any, follower: float) -> Any:
    m, x, y = _nonnegative(1, 1)
    m.cost = pyo.Objective(expr=cost(x[1], y[1]))
    rows = [
        -10 + x[1] + 2 * y[1],
        6 - x[1] + 2 * y[1],
        21 - 2 * x[1] + y[1],
        38 - x[1] - 2 * y[1],
        18 + x[1] - 2 * y[1],
        y[1],
    ]
    state_follower(m, follower * y[1], [y[1]], rows)
    return m


_anandalingam_white = partial(_polygon, lambda x, y: -x - 3 * y, 3.0)
_bialas_karwan = partial(_polygon, lambda x, y: -y + 0 * x, 1.0)


def _bard_falk() -> Any:
    m, x, y = _nonnegative(2, 2)
    m.cost = pyo.Objective(expr=-2 * x[1] + x[2] + 0.5 * y[1])
    m.leader = pyo.Constraint(expr=x[1] + x[2] <= 2)
    rows = [-2.5 + 2 * x[1] - y[1] + y[2], 2 - x[1] + 3 * x[2] - y[2], y[1], y[2]]
    state_follower(m, -4 * y[1] + y[2], [y[1], y[2]], rows)
    return m


def _visweswaran() -> Any:
    m, x, y = _nonnegative(1, 1)
    m.cost = pyo.Objective(expr=x[1] + y[1])
    rows = [-2 + x[1] + 0.5 * y[1], 2 + 0.25 * x[1] - y[1], 8 - x[1] - 0.5 * y[1], 2 - x[1] + 2 * y[1], y[1]]
    state_follower(m, -5 * x[1] - y[1], [y[1]], rows)
    return m


_LINEAR_PROBLEMS = (
    MpccProblem("clark-westerberg 1990", _clark_westerberg_1990, -13.0, tags=LINEAR, source=f"{HANDBOOK}, 9.1.1",
                solution={"x[1]": 5, "y[1]": 4, "y[2]": 2}),
    MpccProblem("liu-hart 1994", _liu_hart, -16.0, tags=LINEAR, source=f"{HANDBOOK}, 9.1.2",
                solution={"x[1]": 4, "y[1]": 4}),
    MpccProblem("candler-townsley 1982", _candler_townsley, -29.2, tags=LINEAR, source=f"{HANDBOOK}, 9.1.3",
                solution={"x[1]": 0, "x[2]": 0.9, "y[1]": 0, "y[2]": 0.6, "y[3]": 0.4}),
    MpccProblem("clark-westerberg 1988", _clark_westerberg_1988, -37.0, tags=LINEAR, source=f"{HANDBOOK}, 9.1.4",
                solution={"x[1]": 19, "y[1]": 14}),
    MpccProblem("bard 1991", _bard_1991, -1.0, tags=LINEAR, source=f"{HANDBOOK}, 9.1.5",
                notes="Two solutions; the follower is indifferent at one of them."),
    MpccProblem("anandalingam-white 1990", _anandalingam_white, -49.0, tags=LINEAR, source=f"{HANDBOOK}, 9.1.6",
                solution={"x[1]": 16, "y[1]": 11}),
    MpccProblem("bialas-karwan 1984", _bialas_karwan, -11.0, tags=LINEAR, solution={"x[1]": 16, "y[1]": 11},
                source="Bialas & Karwan, Management Science 30 (1984)"),
    MpccProblem("bard-falk 1982", _bard_falk, -3.25, tags=LINEAR,
                solution={"x[1]": 2, "x[2]": 0, "y[1]": 1.5, "y[2]": 0},
                source="Bard & Falk, Computers & Oper. Res. 9 (1982), doi:10.1016/0305-0548(82)90007-7"),
    MpccProblem("visweswaran 1996", _visweswaran, 28 / 9, tags=LINEAR, source=f"{HANDBOOK}, 9.1.9",
                solution={"x[1]": 8 / 9, "y[1]": 20 / 9}),
)  # fmt: skip


BILEVEL = frozenset({"bilevel"})
CONVEX = frozenset({"bilevel", "convex"})
MUU_QUY = "Muu & Quy, J. Global Optim. 26 (2003) 199-219"


def _scalars(start: float, upper: float | None = None) -> tuple[Any, Any, Any]:
    """A leader's x and a follower's y, both nonnegative."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(0, upper), initialize=start), pyo.Var(bounds=(0, None), initialize=start)
    return m, m.x, m.y


def _bard1() -> Any:
    m, x, y = _scalars(0.0)
    m.cost = pyo.Objective(expr=(x - 5) ** 2 + (2 * y + 1) ** 2)
    state_follower(m, (y - 1) ** 2 - 1.5 * x * y, [y], [3 * x - y - 3, -x + 0.5 * y + 4, -x - y + 7, y])
    return m


def _bard2() -> Any:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(1, 5), bounds=lambda _, i: (0, (10, 5, 15, 20)[i - 1]), initialize=1)
    m.y = pyo.Var(range(1, 5), bounds=(0, None), initialize=1)
    x, y = m.x, m.y
    first, second = y[1] + y[3], y[2] + y[4]
    m.revenue = pyo.Objective(expr=(200 - first) * first + (160 - second) * second, sense=pyo.maximize)
    m.budget = pyo.Constraint(expr=sum(x.values()) <= 40)
    wishes, limits = {1: 4, 2: 13, 3: 35, 4: 2}, {1: 20, 2: 20, 3: 40, 4: 40}
    for name, i, j in (("first", 1, 2), ("second", 3, 4)):
        rows = [x[i] - 0.4 * y[i] - 0.7 * y[j], x[j] - 0.6 * y[i] - 0.3 * y[j]]
        rows += [y[i], y[j], limits[i] - y[i], limits[j] - y[j]]
        state_follower(m, (y[i] - wishes[i]) ** 2 + (y[j] - wishes[j]) ** 2, [y[i], y[j]], rows, name)
    return m


def _bard3() -> Any:
    m, x, y = _nonnegative(2, 2, 0.5)
    m.cost = pyo.Objective(expr=-(x[1] ** 2) - 3 * x[2] - 4 * y[1] + y[2] ** 2)
    m.leader = pyo.Constraint(expr=x[1] ** 2 + 2 * x[2] <= 4)
    rows = [x[1] ** 2 - 2 * x[1] + x[2] ** 2 - 2 * y[1] + y[2] + 3, x[2] + 3 * y[1] - 4 * y[2] - 4, y[1], y[2]]
    state_follower(m, 2 * x[1] ** 2 + y[1] ** 2 - 5 * y[2], [y[1], y[2]], rows)
    return m


def _bilevel1() -> Any:
    m = pyo.ConcreteModel()
    m.x = pyo.Var([1, 2], bounds=(0, 50), initialize=25)
    m.y = pyo.Var([1, 2], bounds=(-10, 20), initialize=5)
    x, y = m.x, m.y
    m.cost = pyo.Objective(expr=2 * x[1] + 2 * x[2] - 3 * y[1] - 3 * y[2] - 60)
    m.leader = pyo.Constraint(expr=x[1] + x[2] + y[1] - 2 * y[2] <= 40)
    rows = [x[i] - 2 * y[i] - 10 for i in y] + [y[i] + 10 for i in y] + [20 - y[i] for i in y]
    state_follower(m, sum((y[i] - x[i] + 20) ** 2 for i in y), [y[1], y[2]], rows)
    return m


def _shimizu_aiyoshi() -> Any:
    m, x, y = _scalars(1.0, 15)
    m.cost = pyo.Objective(expr=x**2 + (y - 10) ** 2)
    m.leader = pyo.Constraint(expr=y <= x)
    state_follower(m, (x + 2 * y - 30) ** 2, [y], [20 - x - y, y, 20 - y])
    return m


def _shared_resource() -> Any:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(bounds=(0, None), initialize=1)
    m.y = pyo.Var([1, 2], bounds=(0, None), initialize=1)
    y = m.y
    m.cost = pyo.Objective(expr=0.5 * (y[1] - 2) ** 2 + 0.5 * (y[2] - 2) ** 2)
    # The equation y1 + y2 = x of the follower leaves one decision, y2 = x - y1.
    m.rest = pyo.Constraint(expr=y[1] + y[2] == m.x)
    state_follower(m, 0.5 * y[1] ** 2 + m.x - y[1], [y[1]], [y[1], m.x - y[1]])
    return m


def _near_five(in_follower: bool) -> Any:
    m, x, y = _scalars(1.0, 8)
    m.cost = pyo.Objective(expr=(x - 3) ** 2 + (y - 2) ** 2)
    rows = [1 + 2 * x - y, 2 - x + 2 * y, 14 - x - 2 * y]
    if in_follower:
        state_follower(m, (y - 5) ** 2, [y], [*rows, y])
    else:
        m.leader = pyo.Constraint([0, 1, 2], rule=lambda _, i: rows[i] >= 0)
        state_follower(m, (y - 5) ** 2, [y], [y])
    return m


def _projected_leader(curved: bool) -> Any:
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var([1, 2], bounds=(0, 2), initialize=1), pyo.Var([1, 2], initialize=1)
    x, y = m.x, m.y
    m.cost = pyo.Objective(expr=sum(x[i] ** 2 - 2 * x[i] + y[i] ** 2 for i in x))
    if curved:
        rows = [0.25 - (y[i] - 1) ** 2 for i in y]
    else:
        rows = [y[i] - 0.5 for i in y] + [1.5 - y[i] for i in y]
    state_follower(m, sum((y[i] - x[i]) ** 2 for i in y), [y[1], y[2]], rows)
    return m


def _gumus_floudas() -> Any:
    m, x, y = _scalars(5.0, 12.5)
    m.cost = pyo.Objective(expr=16 * x**2 + 9 * y**2)
    m.leader = pyo.Constraint(expr=y <= 4 * x)
    state_follower(m, (x + y - 20) ** 2, [y], [50 - 4 * x - y, y])
    return m


def _muu_quy_1() -> Any:
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(0, 2), initialize=1), pyo.Var([1, 2], bounds=(0, None), initialize=0.5)
    x, y = m.x, m.y
    m.cost = pyo.Objective(expr=y[1] ** 2 + x**2 - 4 * x)
    follower = y[1] ** 2 + 0.5 * y[2] ** 2 + y[1] * y[2] + (1 - 3 * x) * y[1] + (1 + x) * y[2]
    state_follower(m, follower, [y[1], y[2]], [1 + 2 * x - 2 * y[1] - y[2], y[1], y[2]])
    return m


def _muu_quy_2() -> Any:
    m, x, y = _nonnegative(2, 3, 0.5)
    m.cost = pyo.Objective(expr=y[1] ** 2 + y[3] ** 2 - y[1] * y[3] - 4 * y[2] - 7 * x[1] + 4 * x[2])
    m.leader = pyo.Constraint(expr=x[1] + x[2] <= 1)
    follower = y[1] ** 2 + 0.5 * y[2] ** 2 + 0.5 * y[3] ** 2 + y[1] * y[2] + (1 - 3 * x[1]) * y[1] + (1 + x[2]) * y[2]
    rows = [-2 - 2 * y[1] - y[2] + y[3] - x[1] + 2 * x[2], *y.values()]
    state_follower(m, follower, list(y.values()), rows)
    return m


def _gauvin() -> Any:
    m, x, y = _scalars(1.0, 15)
    m.u = pyo.Var(bounds=(0, None), initialize=0)
    m.cost = pyo.Objective(expr=x**2 + (y - 10) ** 2)
    state_pairs(m, [(4 * (x + 2 * y - 30) + m.u, y), (20 - x - y, m.u)])
    return m


def _stackelberg1() -> Any:
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(0, 200), initialize=0), pyo.Var(bounds=(0, None), initialize=0)
    m.cost = pyo.Objective(expr=0.5 * m.x**2 + 0.5 * m.x * m.y - 95 * m.x)
    state_pairs(m, [(2 * m.y + 0.5 * m.x - 100, m.y)])
    return m


PROBLEMS = (
    *_LINEAR_PROBLEMS,
    MpccProblem("bard1", _bard1, 17.0, tags=CONVEX, source=MACMPEC.format("bard1m"), solution={"x": 1, "y": 0}),
    MpccProblem("bard2", _bard2, 6600.0, tags=CONVEX | {"maximise"}, source=MACMPEC.format("bard2m"),
                notes="Bounds of the followers are in their conditions, the upper ones included."),
    MpccProblem("bard3", _bard3, -12.678711, tags=BILEVEL, source=MACMPEC.format("bard3")),
    MpccProblem("bilevel1", _bilevel1, 0.0, tags=CONVEX, source=MACMPEC.format("bilevel1"),
                notes="(25, 30, 5, 10) with cost 5 is a well-known local solution."),
    MpccProblem("shimizu-aiyoshi 1981", _shimizu_aiyoshi, 100.0, tags=CONVEX, source=f"{HANDBOOK}, 9.2.2",
                solution={"x": 10, "y": 10}),
    MpccProblem("shared resource", _shared_resource, 0.5, tags=CONVEX, source=f"{HANDBOOK}, 9.2.4"),
    MpccProblem("near five, rows of the follower", partial(_near_five, True), 5.0, tags=CONVEX,
                source=f"{HANDBOOK}, 9.2.5", solution={"x": 1, "y": 3}),
    MpccProblem("near five, rows of the leader", partial(_near_five, False), 9.0, tags=CONVEX,
                source=f"{HANDBOOK}, 9.2.5, with the rows moved to the leader", solution={"x": 3, "y": 5}),
    MpccProblem("desilva", partial(_projected_leader, True), -1.0, tags=BILEVEL | {"biactive"},
                source=MACMPEC.format("desilva")),
    MpccProblem("falk-liu 1995", partial(_projected_leader, False), -1.0, tags=CONVEX | {"biactive"},
                source=f"{HANDBOOK}, 9.2.6"),
    MpccProblem("gumus-floudas 2001", _gumus_floudas, 2250.0, tags=CONVEX, solution={"x": 11.25, "y": 5},
                source="Gumus & Floudas, J. Global Optim. 20 (2001), doi:10.1023/A:1011268113791, example 1, with the "
                "follower's fourth power replaced by a square", notes="A local solution at (7.2, 12.8) costs 2304."),
    MpccProblem("muu-quy 2003, 1", _muu_quy_1, -27 / 13, tags=CONVEX, source=MUU_QUY),
    MpccProblem("muu-quy 2003, 2", _muu_quy_2, 23 / 36, tags=CONVEX, source=MUU_QUY,
                solution={"x[1]": 11 / 18, "x[2]": 7 / 18}, notes="Published with 0.6426."),
    MpccProblem("gauvin", _gauvin, 20.0, tags=CONVEX, source=MACMPEC.format("gauvin"), solution={"x": 2, "y": 14}),
    MpccProblem("stackelberg1", _stackelberg1, -9800 / 3, tags=BILEVEL, source=MACMPEC.format("stackelberg1"),
                solution={"x": 280 / 3, "y": 80 / 3}, notes="The leader's cost is not convex jointly with y."),
)  # fmt: skip
