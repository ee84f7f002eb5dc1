"""Eight families of random problems, always the same for a seed: fresh cases, whose answers are known by construction.

A point is chosen first, with sides of the pairs that are zero, positive, and both zero; the data are then made so that
it is feasible. Where the cost is the distance from it, its best value is zero; elsewhere its cost is a bound that the
best value cannot exceed. The infeasible and unbounded ones are so on every branch: whoever reports a solution is wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pyomo.environ as pyo
from pyomo.core.expr.visitor import replace_expressions

from pyrobocop_pyomo.complementarity import Complementarity

from .entries import MpccProblem, state_follower, state_pairs
from .generated import _aligned, _planted

# What a problem is made of: model, best value (or a bound for it), and None where there is no solution.
Made = tuple[Any, float | None]


def _quadratic(random: np.random.Generator) -> Made:
    """Quadratic programs with equilibrium constraints, up to 500 pairs, of both kinds of the catalogue."""
    pairs = int(np.exp(random.uniform(np.log(5), np.log(500))))
    kind = _planted if random.random() < 0.5 else _aligned
    return kind(max(2, pairs // int(random.integers(2, 12))), pairs, int(random.integers(10**6))), 0.0


def _bilevel(random: np.random.Generator) -> Made:
    """A follower with a convex quadratic program; the leader wants a pair of decisions that is one of its optima."""
    leader, decisions, rows = int(random.integers(1, 6)), int(random.integers(2, 12)), int(random.integers(2, 15))
    root = random.standard_normal((decisions, decisions))
    weight = root @ root.T / decisions + 0.2 * np.eye(decisions)
    at_x, at_y = random.standard_normal((rows, leader)), random.standard_normal((rows, decisions))
    x, y = random.uniform(-1, 1, leader), random.uniform(-1, 1, decisions)
    kind = random.integers(0, 3, rows)
    multiplier = np.where(kind == 0, random.uniform(0.2, 2, rows), 0.0)
    slack = np.where(kind == 1, random.uniform(0.2, 2, rows), 0.0)
    rest = slack - at_x @ x - at_y @ y
    linear = at_y.T @ multiplier - weight @ y

    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(leader), bounds=(-2, 2), initialize=0)
    m.y = pyo.Var(range(decisions), initialize=0)
    cost = sum(0.5 * weight[i, j] * m.y[i] * m.y[j] for i in m.y for j in m.y) + sum(linear[i] * m.y[i] for i in m.y)
    where = [
        sum(at_x[k, i] * m.x[i] for i in m.x) + sum(at_y[k, j] * m.y[j] for j in m.y) + rest[k] for k in range(rows)
    ]
    state_follower(m, cost, list(m.y.values()), where)
    m.cost = pyo.Objective(expr=sum((m.x[i] - x[i]) ** 2 for i in m.x) + sum((m.y[i] - y[i]) ** 2 for i in m.y))
    return m, 0.0


def _traffic(random: np.random.Generator) -> Made:
    """Tolls on a ring with chords, where drivers to several places settle; observed flows are met exactly."""
    nodes, places = int(random.integers(4, 9)), int(random.integers(1, 4))
    arcs = [(i, (i + 1) % nodes) for i in range(nodes)] + [((i + 1) % nodes, i) for i in range(nodes)]
    arcs += [(i, j) for i in range(nodes) for j in range(nodes) if abs(i - j) > 1 and random.random() < 0.25]
    arcs = sorted(set(arcs))
    goals = [int(goal) for goal in random.choice(nodes, places, replace=False)]
    flow = {(a, g): float(random.choice([0.0, random.uniform(0.2, 3)])) * (a[0] != g) for a in arcs for g in goals}
    demand = {
        (n, g): sum(flow[a, g] for a in arcs if a[0] == n) - sum(flow[a, g] for a in arcs if a[1] == n)
        for n in range(nodes)
        for g in goals
        if n != g
    }
    total = {a: sum(flow[a, g] for g in goals) for a in arcs}
    # Each place has its potentials; the time of a free road is what those who drive on it leave, and at least that.
    distance = {g: {n: float(random.uniform(1, 4)) * (n != g) for n in range(nodes)} for g in goals}
    own = {a: float(random.uniform(0, 0.5)) for a in arcs}
    free = {
        a: max(max(distance[g][a[0]] - distance[g][a[1]] for g in goals), 0.3) + float(random.choice([0.0, 0.4]))
        for a in arcs
    }
    # Where a road is used by somebody, the toll that only they pay makes up for what the others lack.
    extra = {(a, g): distance[g][a[0]] - distance[g][a[1]] - free[a] for a in arcs for g in goals}

    m = pyo.ConcreteModel()
    m.flow = pyo.Var(arcs, goals, bounds=(0, None), initialize=0.5)
    m.time = pyo.Var(range(nodes), goals, initialize=1)
    m.toll = pyo.Var(arcs, bounds=(0, 2), initialize=0)

    def reduced(a: tuple[int, int], g: int) -> Any:
        used = sum(m.flow[a, h] for h in goals)
        offset = extra[a, g] if flow[a, g] > 0 else max(0.0, extra[a, g])
        cost = free[a] + offset + own[a] * (used**2 - total[a] ** 2) + m.toll[a]
        return cost - m.time[a[0], g] + (m.time[a[1], g] if a[1] != g else 0.0)

    m.balance = pyo.Constraint(
        list(demand),
        rule=lambda m, n, g: (
            sum(m.flow[a, g] for a in arcs if a[0] == n) - sum(m.flow[a, g] for a in arcs if a[1] == n) == demand[n, g]
        ),
    )
    for g in goals:
        m.time[g, g].fix(0)
    state_pairs(m, [(m.flow[a, g], reduced(a, g)) for a in arcs for g in goals if a[0] != g])
    for a in arcs:
        for g in goals:
            if a[0] == g:
                m.flow[a, g].fix(0)
    m.cost = pyo.Objective(
        expr=sum((sum(m.flow[a, g] for g in goals) - total[a]) ** 2 for a in arcs)
        + 0.01 * sum(m.toll[a] ** 2 for a in arcs)
    )
    return m, 0.0


def _packing(random: np.random.Generator) -> Made:
    """A membrane over an obstacle: the least width of it with which a given set of points is in contact."""
    size = int(random.integers(4, 14))
    obstacle = random.uniform(-0.2, 0.3, (size, size))
    force = random.uniform(-6, -1, (size, size))
    m = pyo.ConcreteModel()
    m.width = pyo.Var(bounds=(0.5, 2.0), initialize=1)
    grid = [(i, j) for i in range(size) for j in range(size)]
    m.u = pyo.Var(grid, initialize=0.5)
    step = 1.0 / (size + 1)

    def pull(i: int, j: int) -> Any:
        sides = sum(m.u[n] if n in grid_set else 0.0 for n in ((i - 1, j), (i + 1, j)))
        across = sum(m.u[n] if n in grid_set else 0.0 for n in ((i, j - 1), (i, j + 1)))
        second = (2 * m.u[i, j] - sides) / (m.width * step) ** 2 + (2 * m.u[i, j] - across) / step**2
        return (second - float(force[i, j])) * step**2

    grid_set = set(grid)
    state_pairs(m, [(m.u[n] - float(obstacle[n]), pull(*n)) for n in grid])
    m.cost = pyo.Objective(expr=m.width + sum(0.5 * (m.u[n] - float(obstacle[n])) for n in grid) / len(grid))
    return m, _membrane_cost(obstacle, force, step)


def _membrane_cost(obstacle: np.ndarray, force: np.ndarray, step: float) -> float:
    """The cost of the membranes of some widths, each by projected relaxation: a bound for the best value."""
    best = np.inf
    for width in np.linspace(0.5, 2.0, 7):
        u = np.maximum(obstacle, 0.0)
        along, across = 1.0 / (width * step) ** 2, 1.0 / step**2
        for _ in range(4000):
            before = u.copy()
            for i in range(u.shape[0]):
                for j in range(u.shape[1]):
                    total = force[i, j]
                    total += along * ((u[i - 1, j] if i else 0.0) + (u[i + 1, j] if i + 1 < len(u) else 0.0))
                    total += across * ((u[i, j - 1] if j else 0.0) + (u[i, j + 1] if j + 1 < len(u) else 0.0))
                    u[i, j] = max(obstacle[i, j], total / (2 * along + 2 * across))
            if np.max(np.abs(u - before)) < 1e-12:
                break
        best = min(best, width + 0.5 * float(np.mean(u - obstacle)))
    return best


def _contact(random: np.random.Generator) -> Made:
    """Blocks on a line with dry friction, pushed by the first, to where a plan that is known leads them."""
    blocks, steps, h = int(random.integers(1, 4)), int(random.integers(10, 40)), 0.1
    grip = random.uniform(0.5, 2.0, blocks)
    force = np.repeat(random.uniform(-6, 6, 5), -(-steps // 5))[:steps]
    # The known plan pushes the first block alone, and the others are out of its way: they stay.
    q, v, path = 0.0, 0.0, [0.0]
    for push in force:
        moved = v + h * push
        v = float(np.sign(moved) * max(0.0, abs(moved) - h * grip[0]))
        q += h * v
        path.append(q)
    places = [0.0, *(max(path) + 1.0 + k for k in range(blocks - 1))]

    m = pyo.ConcreteModel()
    m.k, m.b = pyo.RangeSet(0, steps), pyo.RangeSet(0, blocks - 1)
    m.q = pyo.Var(m.k, m.b, initialize=lambda m, k, b: places[b])
    m.v = pyo.Var(m.k, m.b, initialize=0)
    m.u = pyo.Var(pyo.RangeSet(1, steps), bounds=(-6, 6), initialize=0)
    m.forward = pyo.Var(pyo.RangeSet(1, steps), m.b, bounds=(0, None), initialize=0)
    m.backward = pyo.Var(pyo.RangeSet(1, steps), m.b, bounds=(0, None), initialize=0)
    m.slide = pyo.Var(pyo.RangeSet(1, steps), m.b, bounds=(0, None), initialize=0)
    m.touch = pyo.Var(pyo.RangeSet(1, steps), range(1, blocks), bounds=(0, None), initialize=0)
    for b in m.b:
        m.q[0, b].fix(places[b])
        m.v[0, b].fix(0)

    def newton(m: Any, k: int, b: int) -> Any:
        contact = (m.touch[k, b] if b > 0 else 0.0) - (m.touch[k, b + 1] if b + 1 < blocks else 0.0)
        push = m.u[k] if b == 0 else 0.0
        return m.v[k, b] - m.v[k - 1, b] == h * (push + contact - m.forward[k, b] + m.backward[k, b])

    m.newton = pyo.Constraint(pyo.RangeSet(1, steps), m.b, rule=newton)
    m.moves = pyo.Constraint(
        pyo.RangeSet(1, steps), m.b, rule=lambda m, k, b: m.q[k, b] == m.q[k - 1, b] + h * m.v[k, b]
    )
    m.goal = pyo.Constraint(expr=m.q[steps, 0] == float(q))
    pairs = []
    for k in range(1, steps + 1):
        for b in range(blocks):
            pairs.append((m.forward[k, b], m.slide[k, b] + m.v[k, b]))
            pairs.append((m.backward[k, b], m.slide[k, b] - m.v[k, b]))
            pairs.append((m.slide[k, b], float(grip[b]) - m.forward[k, b] - m.backward[k, b]))
        pairs += [(m.touch[k, b], m.q[k, b] - m.q[k, b - 1] - 0.5) for b in range(1, blocks)]
    state_pairs(m, pairs)
    m.cost = pyo.Objective(expr=h * sum(m.u[k] ** 2 for k in range(1, steps + 1)))
    return m, float(h * np.sum(force**2))


def _infeasible(random: np.random.Generator) -> Made:
    """Both sides of one pair among many are kept from zero, behind a rotation of all variables."""
    n = int(random.integers(2, 30))
    rotation = np.linalg.qr(random.standard_normal((2 * n, 2 * n)))[0]
    m = pyo.ConcreteModel()
    m.z = pyo.Var(range(2 * n), initialize=lambda m, i: float(random.uniform(-1, 1)))
    sides = [sum(float(c) * m.z[i] for i, c in enumerate(row)) for row in rotation]
    state_pairs(m, [(sides[2 * i], sides[2 * i + 1]) for i in range(n)])
    chosen, least = int(random.integers(n)), float(random.uniform(0.2, 1.0))
    a, b = sides[2 * chosen], sides[2 * chosen + 1]
    m.sum = pyo.Constraint(expr=a + b == 2 * least)
    m.difference = pyo.Constraint(expr=(a - b) ** 2 <= (0.9 * least) ** 2)
    m.cost = pyo.Objective(expr=sum((m.z[i] - 0.3) ** 2 for i in m.z))
    return m, None


def _unbounded(random: np.random.Generator) -> Made:
    """A linear cost that falls without end on one side of every pair, and rises on the other."""
    n = int(random.integers(2, 20))
    up, down = random.uniform(0.5, 2, n), random.uniform(0.5, 2, n)
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(n), bounds=(0, None), initialize=1)
    m.y = pyo.Var(range(n), bounds=(0, None), initialize=1)
    state_pairs(m, [(m.x[i], m.y[i]) for i in range(n)])
    free = int(random.integers(n))
    m.cap = pyo.Constraint(expr=sum(m.y[i] for i in m.y) <= 2.0 * n)
    m.cost = pyo.Objective(
        expr=sum(float(up[i]) * m.x[i] for i in m.x if i != free)
        - float(up[free]) * m.x[free]
        + sum(float(down[i]) * (m.y[i] - 1) ** 2 for i in m.y)
    )
    return m, None


def _badly_scaled(random: np.random.Generator) -> Made:
    """One of the others, with variables in units, and sides of pairs by factors, of six orders of magnitude."""
    model, best = (_quadratic, _bilevel, _contact)[int(random.integers(3))](random)

    def factor() -> float:
        return float(10.0 ** random.uniform(-3, 3))

    replaced = {}
    for variable in model.component_data_objects(pyo.Var):
        unit = factor()
        replaced[id(variable)] = unit * variable
        variable.setlb(None if variable.lb is None else variable.lb / unit)
        variable.setub(None if variable.ub is None else variable.ub / unit)
        variable.set_value(variable.value / unit, skip_validation=True)
    for row in model.component_data_objects((pyo.Constraint, pyo.Objective), descend_into=True):
        row.set_value(replace_expressions(row.expr, replaced))
    for component in list(model.component_objects(Complementarity)):
        # Each side says that an expression is nonnegative.
        sides = [[replace_expressions(side.args[1], replaced) for side in data.args] for data in component.values()]
        block = component.parent_block()
        block.del_component(component)
        state_pairs(block, [(factor() * first, factor() * second) for first, second in sides])
    return model, best


FAMILIES: dict[str, Callable[[np.random.Generator], Made]] = {
    "quadratic": _quadratic,
    "bilevel": _bilevel,
    "traffic": _traffic,
    "packing": _packing,
    "contact": _contact,
    "infeasible": _infeasible,
    "unbounded": _unbounded,
    "badly scaled": _badly_scaled,
}


def random_problems(first: int, each: int) -> Iterator[MpccProblem]:
    """Yield so many problems of each family, for the seeds from `first` on."""
    for family, made in FAMILIES.items():
        for seed in range(first, first + each):
            model, best = made(np.random.default_rng(seed))
            del model
            yield MpccProblem(
                f"{family} {seed}",
                lambda made=made, seed=seed: made(np.random.default_rng(seed))[0],
                best,
                feasible=best is not None,
                tags=frozenset({family}),
            )
