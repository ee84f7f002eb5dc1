"""Strings and membranes over obstacles, on grids: many pairs, each touching its neighbours only."""

from __future__ import annotations

from functools import partial
from typing import Any

import pyomo.environ as pyo

from .entries import MpccProblem, state_pairs

OBSTACLE = frozenset({"obstacle"})
CONVEX = frozenset({"obstacle", "convex"})
OUTRATA = "Outrata, Kocvara & Zowe, Nonsmooth Approach to Optimization Problems with Equilibrium Constraints (1998)"


def _curvature(height: Any, i: int, nodes: int) -> Any:
    """The negative second difference of heights that are zero at both ends."""
    before, after = (height[j] if 1 <= j <= nodes else 0.0 for j in (i - 1, i + 1))
    return 2 * height[i] - before - after


def _string(nodes: int) -> Any:
    """A string under a load that is chosen; it rests on a floor at -1 and should touch it in the middle half only."""
    m = pyo.ConcreteModel()
    inner = range(1, nodes + 1)
    scale = (nodes + 1.0) ** 2
    m.pull = pyo.Var(inner, bounds=(-30, 30), initialize=0)
    m.height, m.force = pyo.Var(inner, initialize=0), pyo.Var(inner, bounds=(0, None), initialize=0)

    m.balance = pyo.Constraint(
        inner, rule=lambda m, i: _curvature(m.height, i, nodes) * scale / 4 == m.pull[i] + m.force[i]
    )
    state_pairs(m, [(m.force[i], m.height[i] + 1) for i in inner])
    wanted = {i: -1.0 if abs(2 * i / (nodes + 1) - 1) <= 0.5 else 0.0 for i in inner}
    m.cost = pyo.Objective(
        expr=sum((m.height[i] - wanted[i]) ** 2 + 1e-3 * m.pull[i] ** 2 for i in inner) / (nodes + 1)
    )
    return m


def _wanted_state(i: int, j: int, cells: int) -> tuple[float, float]:
    """Height and contact force of the planted solution: a quarter lifts off, a quarter bears, the rest just touches."""
    x, y = i / cells, j / cells
    if x < 0.5 and y < 0.5:
        return 4 * x * (0.5 - x) * y * (0.5 - y), 0.0
    if x > 0.5 and y > 0.5:
        return 0.0, 4 * (x - 0.5) * (1 - x) + 1.0
    return 0.0, 0.0


def _membrane(cells: int) -> Any:
    """A membrane on the floor is pulled by a field of loads; height and contact force are measured."""
    m = pyo.ConcreteModel()
    points = [(i, j) for i in range(1, cells) for j in range(1, cells)]
    m.height, m.force = pyo.Var(points, bounds=(0, None), initialize=0), pyo.Var(points, bounds=(0, None), initialize=0)
    m.pull = pyo.Var(points, initialize=0)

    def height(i: int, j: int) -> Any:
        return m.height[i, j] if 0 < i < cells and 0 < j < cells else 0.0

    def laplacian(i: int, j: int) -> Any:
        around = height(i - 1, j) + height(i + 1, j) + height(i, j - 1) + height(i, j + 1)
        return (4 * m.height[i, j] - around) * float(cells**2) / 16

    m.balance = pyo.Constraint(points, rule=lambda m, i, j: laplacian(i, j) == m.pull[i, j] + m.force[i, j])
    state_pairs(m, [(m.height[p], m.force[p]) for p in points])
    m.cost = pyo.Objective(
        expr=sum(
            100 * (m.height[i, j] - _wanted_state(i, j, cells)[0]) ** 2
            + (m.force[i, j] - _wanted_state(i, j, cells)[1]) ** 2
            for i, j in points
        )
    )
    return m


def _packaging(nodes: int) -> Any:
    """The smallest package: a flap over an obstacle ends at x; it has to touch the obstacle."""
    m = pyo.ConcreteModel()
    inner = range(1, nodes + 1)
    m.length = pyo.Var(bounds=(0.6, 1.4), initialize=1)
    m.height, m.force = pyo.Var(inner, initialize=0), pyo.Var(inner, bounds=(0, None), initialize=0)

    step = m.length / (nodes + 1)
    m.balance = pyo.Constraint(
        inner, rule=lambda m, i: _curvature(m.height, i, nodes) == step**2 * (-4) + step * m.force[i]
    )

    def floor(i: int) -> Any:
        return -0.2 - 0.3 * (i * step - 0.5) ** 2

    state_pairs(m, [(m.force[i], m.height[i] - floor(i)) for i in inner])
    m.cost = pyo.Objective(expr=m.length + 10 * (sum(m.force.values()) - 0.4) ** 2)
    return m


def _complementary_heat(nodes: int) -> Any:
    """Freezing of a rod: temperature and ice fraction exclude each other; heat at one end is to be chosen."""
    m = pyo.ConcreteModel()
    index = range(nodes + 1)
    m.heat = pyo.Var(bounds=(-5, 5), initialize=0)
    m.warm, m.cold = pyo.Var(index, bounds=(0, None), initialize=0), pyo.Var(index, bounds=(0, None), initialize=0)
    m.flux = pyo.Constraint(
        range(1, nodes),
        rule=lambda m, i: (
            2 * m.warm[i] - m.warm[i - 1] - m.warm[i + 1] == 3 * (2 * m.cold[i] - m.cold[i - 1] - m.cold[i + 1])
        ),
    )
    m.left = pyo.Constraint(expr=m.warm[0] - 3 * m.cold[0] == m.heat)
    m.right = pyo.Constraint(expr=m.warm[nodes] - 3 * m.cold[nodes] == -1.5)
    state_pairs(m, [(m.warm[i], m.cold[i]) for i in index])
    m.cost = pyo.Objective(expr=sum(m.cold[i] for i in index) / nodes + 0.2 * m.heat**2)
    return m


PROBLEMS = (
    *(
        MpccProblem(f"string over a floor {n}", partial(_string, n), best, tags=CONVEX, source=f"kind: {OUTRATA}",
                    notes="The floor is where the string is wanted: half of the pairs is nearly biactive.")
        for n, best in ((7, 0.041747188), (15, 0.058020468), (31, 0.062014826))
    ),
    *(
        MpccProblem(f"membrane {n}x{n}", partial(_membrane, n), 0.0, source=f"kind: {OUTRATA}",
                    tags=CONVEX | {"biactive"} | (frozenset({"large"}) if n >= 12 else frozenset()),
                    notes="Zero cost at the planted solution, where half of the points are biactive.")
        for n in (6, 12, 20)
    ),
    MpccProblem("packaging 5", partial(_packaging, 5), 0.74587523, tags=OBSTACLE, source=f"kind: {OUTRATA}"),
    MpccProblem("freezing rod 10", partial(_complementary_heat, 10), 0.252, tags=CONVEX,
                source="written for this catalogue"),
    MpccProblem("freezing rod 100", partial(_complementary_heat, 100), 0.22882198, tags=CONVEX | {"large"},
                source="written for this catalogue"),
)  # fmt: skip
