"""Linear bilevel programs through the optimality conditions of the follower: linear in every branch."""

from __future__ import annotations

from typing import Any

import pyomo.environ as pyo

from .entries import MpccProblem
from .stating import state_follower

HANDBOOK = "Floudas et al., Handbook of Test Problems (1999), ch. 9, doi:10.1007/978-1-4757-3040-1"
LINEAR = frozenset({"bilevel", "linear", "convex"})


def _nonnegative(m: Any, leader: int, followers: int, start: float = 1.0) -> tuple[Any, Any]:
    m.x = pyo.Var(range(1, leader + 1), bounds=(0, None), initialize=start)
    m.y = pyo.Var(range(1, followers + 1), bounds=(0, None), initialize=start)
    return m.x, m.y


def _clark_westerberg_1990() -> Any:
    m = pyo.ConcreteModel()
    x, y = _nonnegative(m, 1, 2)
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
    m = pyo.ConcreteModel()
    x, y = _nonnegative(m, 1, 1)
    m.cost = pyo.Objective(expr=-x[1] - 3 * y[1])
    rows = [3 + x[1] - y[1], 12 - x[1] - 2 * y[1], 12 - 4 * x[1] + y[1], y[1]]
    state_follower(m, y[1] + 0, [y[1]], rows)
    return m


def _candler_townsley() -> Any:
    m = pyo.ConcreteModel()
    x, y = _nonnegative(m, 2, 3)
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
    m = pyo.ConcreteModel()
    x, y = _nonnegative(m, 1, 1)
    m.cost = pyo.Objective(expr=x[1] - 4 * y[1])
    rows = [2 * x[1] - y[1], 108 - 2 * x[1] - 5 * y[1], -4 - 2 * x[1] + 3 * y[1], y[1]]
    state_follower(m, y[1] + 0, [y[1]], rows)
    return m


def _bard_1991() -> Any:
    m = pyo.ConcreteModel()
    x, y = _nonnegative(m, 1, 2)
    m.cost = pyo.Objective(expr=-x[1] + 10 * y[1] - y[2])
    rows = [1 - x[1] - y[1], 1 - x[1] - y[2], 1 - y[1] - y[2], y[1], y[2]]
    state_follower(m, -y[1] - y[2], [y[1], y[2]], rows)
    return m


def _polygon(cost: Any, follower: float) -> Any:
    m = pyo.ConcreteModel()
    x, y = _nonnegative(m, 1, 1)
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


def _anandalingam_white() -> Any:
    return _polygon(lambda x, y: -x - 3 * y, 3.0)


def _bialas_karwan() -> Any:
    return _polygon(lambda x, y: -y + 0 * x, 1.0)


def _bard_falk() -> Any:
    m = pyo.ConcreteModel()
    x, y = _nonnegative(m, 2, 2)
    m.cost = pyo.Objective(expr=-2 * x[1] + x[2] + 0.5 * y[1])
    m.leader = pyo.Constraint(expr=x[1] + x[2] <= 2)
    rows = [-2.5 + 2 * x[1] - y[1] + y[2], 2 - x[1] + 3 * x[2] - y[2], y[1], y[2]]
    state_follower(m, -4 * y[1] + y[2], [y[1], y[2]], rows)
    return m


def _visweswaran() -> Any:
    m = pyo.ConcreteModel()
    x, y = _nonnegative(m, 1, 1)
    m.cost = pyo.Objective(expr=x[1] + y[1])
    rows = [
        -2 + x[1] + 0.5 * y[1],
        2 + 0.25 * x[1] - y[1],
        8 - x[1] - 0.5 * y[1],
        2 - x[1] + 2 * y[1],
        y[1],
    ]
    state_follower(m, -5 * x[1] - y[1], [y[1]], rows)
    return m


PROBLEMS = (
    MpccProblem("clark-westerberg 1990", _clark_westerberg_1990, -13.0, tags=LINEAR, source=f"{HANDBOOK}, 9.1.1",
                answer={"x[1]": 5, "y[1]": 4, "y[2]": 2}),
    MpccProblem("liu-hart 1994", _liu_hart, -16.0, tags=LINEAR, source=f"{HANDBOOK}, 9.1.2",
                answer={"x[1]": 4, "y[1]": 4}),
    MpccProblem("candler-townsley 1982", _candler_townsley, -29.2, tags=LINEAR, source=f"{HANDBOOK}, 9.1.3",
                answer={"x[1]": 0, "x[2]": 0.9, "y[1]": 0, "y[2]": 0.6, "y[3]": 0.4}),
    MpccProblem("clark-westerberg 1988", _clark_westerberg_1988, -37.0, tags=LINEAR, source=f"{HANDBOOK}, 9.1.4",
                answer={"x[1]": 19, "y[1]": 14}),
    MpccProblem("bard 1991", _bard_1991, -1.0, tags=LINEAR, source=f"{HANDBOOK}, 9.1.5",
                notes="Two solutions; the follower is indifferent at one of them."),
    MpccProblem("anandalingam-white 1990", _anandalingam_white, -49.0, tags=LINEAR, source=f"{HANDBOOK}, 9.1.6",
                answer={"x[1]": 16, "y[1]": 11}),
    MpccProblem("bialas-karwan 1984", _bialas_karwan, -11.0, tags=LINEAR, answer={"x[1]": 16, "y[1]": 11},
                source="Bialas & Karwan, Management Science 30 (1984)"),
    MpccProblem("bard-falk 1982", _bard_falk, -3.25, tags=LINEAR, answer={"x[1]": 2, "x[2]": 0, "y[1]": 1.5, "y[2]": 0},
                source="Bard & Falk, Computers & Oper. Res. 9 (1982), doi:10.1016/0305-0548(82)90007-7"),
    MpccProblem("visweswaran 1996", _visweswaran, 28 / 9, tags=LINEAR, source=f"{HANDBOOK}, 9.1.9",
                answer={"x[1]": 8 / 9, "y[1]": 20 / 9}),
)  # fmt: skip
