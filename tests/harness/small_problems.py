"""Small problems with known answers, and the ways to solve them."""

from collections.abc import Mapping

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
import pyrobocop_pyomo.ipopt.in_process


def hock_schittkowski_71() -> tuple[pyo.ConcreteModel, float]:
    """Problem 71 of Hock & Schittkowski (1981): bounds, an inequality, an equation."""
    m = pyo.ConcreteModel("hs71")
    m.x = pyo.Var([1, 2, 3, 4], bounds=(1, 5), initialize={1: 1, 2: 5, 3: 5, 4: 1})
    x = m.x
    m.cost = pyo.Objective(expr=x[1] * x[4] * (x[1] + x[2] + x[3]) + x[3])
    m.product = pyo.Constraint(expr=x[1] * x[2] * x[3] * x[4] >= 25)
    m.sphere = pyo.Constraint(expr=sum(x[i] ** 2 for i in (1, 2, 3, 4)) == 40)
    return m, 17.0140172891520542


def maximisation() -> tuple[pyo.ConcreteModel, float]:
    """The largest rectangle in a quarter of an ellipse: x y <= a b / 2 with a = 2, b = 1."""
    m = pyo.ConcreteModel("maximisation")
    m.x = pyo.Var(bounds=(0, None), initialize=0.5)
    m.y = pyo.Var(bounds=(0, None), initialize=0.5)
    m.area = pyo.Objective(expr=m.x * m.y, sense=pyo.maximize)
    m.ellipse = pyo.Constraint(expr=m.x**2 / 4 + m.y**2 <= 1)
    return m, 1.0


def square_system() -> tuple[pyo.ConcreteModel, float]:
    """No objective, as many equations as variables: a circle and a line meet at (1, 1)."""
    m = pyo.ConcreteModel("square")
    m.x, m.y = pyo.Var(initialize=2), pyo.Var(initialize=0.5)
    m.circle = pyo.Constraint(expr=m.x**2 + m.y**2 == 2)
    m.line = pyo.Constraint(expr=m.x + m.y == 2.0)
    m.line.deactivate()
    m.slope = pyo.Constraint(expr=m.x - m.y == 0)
    return m, 0.0


def fixed_variable() -> tuple[pyo.ConcreteModel, float]:
    """A variable that is fixed takes part as a number; one that nothing uses takes no part."""
    m = pyo.ConcreteModel("fixed")
    m.x = pyo.Var([1, 2, 3], initialize=1.0)
    m.unused = pyo.Var()
    m.x[2].fix(3.0)
    m.cost = pyo.Objective(expr=(m.x[1] - m.x[2]) ** 2 + (m.x[3] + 1) ** 2 + 5)
    m.row = pyo.Constraint(expr=m.x[1] + m.x[2] * m.x[3] == 0)
    m.trivial = pyo.Constraint(expr=m.x[2] <= 4)
    return m, 5.0


def linear_equality() -> tuple[pyo.ConcreteModel, float]:
    """The point of the plane x + 2 y + 3 z = 14 that is closest to the origin: (1, 2, 3)."""
    m = pyo.ConcreteModel("plane")
    m.x = pyo.Var([1, 2, 3], initialize=0.0)
    m.cost = pyo.Objective(expr=sum(m.x[i] ** 2 for i in m.x))
    m.plane = pyo.Constraint(expr=sum(i * m.x[i] for i in m.x) == 14)
    return m, 14.0


def every_kind_of_row(sense: int = pyo.minimize) -> pyo.ConcreteModel:
    """Active and idle bounds and rows of every kind; the multipliers of all are unique."""
    m = pyo.ConcreteModel("rows")
    m.x = pyo.Var(range(7), initialize=0.3)
    m.x[6].setub(0.2)
    m.x[0].setlb(1.5)
    m.x[1].setub(-0.5)
    m.x[2].setlb(-10)
    m.x[2].setub(10)
    cost = sum((v - 0.1 * i) ** 2 * (1 + i) for i, v in m.x.items()) + m.x[4] * m.x[5]
    m.cost = pyo.Objective(expr=cost if sense == pyo.minimize else -cost, sense=sense)
    m.range_low = pyo.Constraint(expr=(1, m.x[2] + m.x[3] ** 2, 4))
    m.range_high = pyo.Constraint(expr=(-4, m.x[3] - m.x[4], -1))
    m.at_least = pyo.Constraint(expr=m.x[5] >= m.x[4] + 0.2)
    m.at_most = pyo.Constraint(expr=m.x[0] + m.x[5] <= 1)
    m.equation = pyo.Constraint(expr=m.x[1] * m.x[4] == -0.1 - m.x[5])
    for name in ("dual", "ipopt_zL_out", "ipopt_zU_out", "rc"):
        m.add_component(name, pyo.Suffix(direction=pyo.Suffix.IMPORT))
    return m


def corners(goals: Mapping[int, tuple[float, float]]) -> pyo.ConcreteModel:
    """The points nearest to goals, each with ``a`` and ``b`` not negative and one of them zero."""
    m = pyo.ConcreteModel(name="corners")
    m.i = pyo.Set(initialize=list(goals))
    m.a, m.b = pyo.Var(m.i, bounds=(0, None), initialize=1), pyo.Var(m.i, bounds=(0, None), initialize=1)
    m.pair = rcp.Complementarity(m.i, rule=lambda m, i: rcp.complements(m.a[i] >= 0, m.b[i] >= 0))
    m.cost = pyo.Objective(expr=sum((m.a[i] - p) ** 2 + (m.b[i] - q) ** 2 for i, (p, q) in goals.items()))
    return m


def corner(
    goal: tuple[float, float] = (2, 1), start: tuple[float, float] = (1, 1), weight: float = 1.0
) -> pyo.ConcreteModel:
    """The point nearest to a goal with x and y not negative and one of them zero: by default (2, 0), at a cost of 1."""
    m = pyo.ConcreteModel(name="corner")
    m.x, m.y = (pyo.Var(bounds=(0, None), initialize=each) for each in start)
    m.pair = rcp.Complementarity(expr=rcp.complements(m.x >= 0, m.y >= 0))
    m.cost = pyo.Objective(expr=weight * ((m.x - goal[0]) ** 2 + (m.y - goal[1]) ** 2))
    return m


PROBLEMS = [hock_schittkowski_71, maximisation, square_system, fixed_variable, linear_equality]

BACKENDS = {
    "ipopt": pytest.mark.executable,
    "ipopt_v2": pytest.mark.executable,
    "asl": pytest.mark.asl,
    "vectorised": pytest.mark.casadi,
}

every_backend = pytest.mark.parametrize("backend", [pytest.param(name, marks=mark) for name, mark in BACKENDS.items()])
every_derivative = pytest.mark.parametrize(
    "derivatives",
    [
        pytest.param("asl", marks=pytest.mark.asl),
        pytest.param("vectorised", marks=pytest.mark.casadi),
    ],
)


def solver(backend: str) -> object:
    """The solver of a backend, in Pyomo's older interface, which all of them have."""
    if backend in ("asl", "vectorised"):
        return pyo.SolverFactory("pyrobocop.ipopt", derivatives=backend)
    if backend == "ipopt_v2":
        return pyo.SolverFactory(backend, writer_config={"linear_presolve": False, "scale_model": False})
    return pyo.SolverFactory(backend)
