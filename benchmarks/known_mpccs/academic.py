"""One to four pairs: the small problems on which methods are explained and told apart."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import pyomo.environ as pyo

from .entries import MpccProblem, state_pairs

MACMPEC = "MacMPEC (S. Leyffer, Argonne National Laboratory), problem {}"
ACADEMIC = frozenset({"academic", "convex"})
SCALED = frozenset({"academic", "convex", "scaling"})


def plane(cost: Callable[[Any, Any], Any], start: tuple[float, float] = (0.0, 0.0), **sides: float) -> Any:
    """Two variables ``0 <= x ⟂ y >= 0`` and a cost; `sides` may scale them."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(0, None), initialize=start[0]), pyo.Var(bounds=(0, None), initialize=start[1])
    m.cost = pyo.Objective(expr=cost(m.x, m.y))
    state_pairs(m, [(sides.get("x", 1) * m.x, sides.get("y", 1) * m.y)])
    return m


_kth1 = partial(plane, lambda x, y: x + y)
_kth2 = partial(plane, lambda x, y: x + (y - 1) ** 2)
_kth3 = partial(plane, lambda x, y: 0.5 * (x - 1) ** 2 + (y - 1) ** 2)
_scholtes3 = partial(plane, lambda x, y: 0.5 * ((x - 1) ** 2 + (y - 1) ** 2), (0, 1))
_scale1 = partial(plane, lambda x, y: (100 * x - 1) ** 2 + (y - 1) ** 2, (1, 1))
_scale2 = partial(plane, lambda x, y: (x - 1) ** 2 + (100 * y - 1) ** 2, (1, 1))
_scale3 = partial(plane, lambda x, y: (x - 1) ** 2 + (y - 1) ** 2, (1, 1), x=100)
_scale4 = partial(plane, lambda x, y: (x - 1) ** 2 + (y - 1) ** 2, (1, 1), y=100)
_scale5 = partial(plane, lambda x, y: 100 * ((x - 1) ** 2 + (y - 1) ** 2), (1, 1))


def _kinked(cost: Callable[[Any, Any], Any]) -> Any:
    """``0 <= y ⟂ y - x >= 0``: y is the positive part of x."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=0), pyo.Var(bounds=(0, None), initialize=0)
    m.cost = pyo.Objective(expr=cost(m.x, m.y))
    state_pairs(m, [(m.y, m.y - m.x)])
    return m


_jr1 = partial(_kinked, lambda x, y: (x - 1) ** 2 + y**2)
_jr2 = partial(_kinked, lambda x, y: (y - 1) ** 2 + x**2)


def _df1() -> Any:
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(-1, 2), initialize=0), pyo.Var(bounds=(0, None), initialize=0)
    m.cost = pyo.Objective(expr=(m.x - 1 - m.y) ** 2)
    m.interval = pyo.Constraint(expr=m.x**2 <= 2)
    m.disk = pyo.Constraint(expr=(m.x - 1) ** 2 + (m.y - 1) ** 2 <= 3)
    state_pairs(m, [(m.y - m.x**2 + 1, m.y)])
    return m


def _projection(dimension: int) -> Any:
    """Nearest point of the set ``0 <= x_i ⟂ y_i >= 0`` to given points of the plane: separable."""
    m = pyo.ConcreteModel()
    index = range(1, dimension + 1)
    m.x = pyo.Var(index, bounds=(0, None), initialize=0.5)
    m.y = pyo.Var(index, bounds=(0, None), initialize=0.5)
    m.cost = pyo.Objective(expr=sum((m.x[i] - i % 5) ** 2 + (m.y[i] - i % 3) ** 2 for i in index))
    state_pairs(m, [(m.x[i], m.y[i]) for i in index])
    return m


def projected(dimension: int) -> float:
    """The solution of `_projection`: in each plane the smaller coordinate is zero."""
    return float(sum(min(i % 5, i % 3) ** 2 for i in range(1, dimension + 1)))


def _disk() -> Any:
    """The farthest reach into a disk along one of the two axes."""
    m = plane(lambda x, y: -x - 2 * y, (0.1, 0.1))
    m.disk = pyo.Constraint(expr=(m.x - 1) ** 2 + (m.y - 1) ** 2 <= 2)
    return m


def _three_in_a_row() -> Any:
    """Neighbours in a chain exclude each other: a stable set of largest weight, continuous."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(1, 5), bounds=(0, 1), initialize=0.5)
    m.cost = pyo.Objective(expr=-2 * m.x[1] - 3 * m.x[2] - 2 * m.x[3] - 2 * m.x[4])
    state_pairs(m, [(m.x[i], m.x[i + 1]) for i in (1, 2, 3)])
    return m


PROBLEMS = (
    MpccProblem("kth1", _kth1, 0.0, source=MACMPEC.format("kth1"), tags=ACADEMIC | {"linear", "biactive"},
                solution={"x": 0, "y": 0}),
    MpccProblem("kth2", _kth2, 0.0, source=MACMPEC.format("kth2"), tags=ACADEMIC, solution={"x": 0, "y": 1}),
    MpccProblem("kth3", _kth3, 0.5, source=MACMPEC.format("kth3"), tags=ACADEMIC, solution={"x": 0, "y": 1},
                notes="(1, 0) is a local solution with cost 1, and the origin is C-stationary."),
    MpccProblem("scholtes3", _scholtes3, 0.5, source=MACMPEC.format("scholtes3"), tags=ACADEMIC,
                solution={"x": 0, "y": 1}, notes="Two global solutions; the origin is C-stationary, not a solution."),
    MpccProblem("scale1", _scale1, 1.0, source=MACMPEC.format("scale1"), tags=SCALED, solution={"x": 0.01, "y": 0},
                notes="(0, 1) and (0.01, 0) cost the same."),
    MpccProblem("scale2", _scale2, 1.0, source=MACMPEC.format("scale2"), tags=SCALED, solution={"x": 1, "y": 0}),
    MpccProblem("scale3", _scale3, 1.0, source=MACMPEC.format("scale3"), tags=SCALED, solution={"x": 1, "y": 0}),
    MpccProblem("scale4", _scale4, 1.0, source=MACMPEC.format("scale4"), tags=SCALED, solution={"x": 1, "y": 0}),
    MpccProblem("scale5", _scale5, 100.0, source=MACMPEC.format("scale5"), tags=SCALED, solution={"x": 1, "y": 0}),
    MpccProblem("jr1", _jr1, 0.5, source=MACMPEC.format("jr1"), tags=ACADEMIC, solution={"x": 0.5, "y": 0.5}),
    MpccProblem("jr2", _jr2, 0.5, source=MACMPEC.format("jr2"), tags=ACADEMIC, solution={"x": 0.5, "y": 0.5}),
    MpccProblem("df1", _df1, 0.0, source=MACMPEC.format("df1"), tags=frozenset({"academic", "biactive"}),
                solution={"x": 1, "y": 0}, notes="Biactive at the solution; one side is not convex."),
    MpccProblem("projection 5", partial(_projection, 5), projected(5), tags=ACADEMIC,
                source="separable, by inspection"),
    MpccProblem("projection 500", partial(_projection, 500), projected(500), source="separable, by inspection",
                tags=ACADEMIC | {"large"}, notes="2^500 branches, each pair alone trivial; many local solutions."),
    MpccProblem("disk", _disk, -4.0, source="by inspection: (0, 2)", tags=ACADEMIC, solution={"x": 0, "y": 2}),
    MpccProblem("stable set", _three_in_a_row, -5.0, source="by inspection: x2 = x4 = 1",
                tags=ACADEMIC | {"linear"}, solution={"x[1]": 0, "x[2]": 1, "x[3]": 0, "x[4]": 1},
                notes="The inner variables are in two pairs each; x1 and x3, or x1 and x4, are worth -4."),
)  # fmt: skip
