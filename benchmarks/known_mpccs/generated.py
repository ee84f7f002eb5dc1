"""Programs made from random numbers: quadratic ones with affine pairs, of many sizes, always the same for a seed.

The pairs are ``0 <= y ⟂ N x + M y + q >= 0`` with M monotone, as in the generator of Jiang & Ralph, Comput. Optim.
Appl. 13 (1999), 25-59. Two kinds have solutions by construction: the "planted" ones, whose cost is
the distance to a complementary point, so that the best value is zero; and the "aligned" ones, whose cost has its
minimum over the relaxed set (pairs left out) at a complementary point, by multipliers that are chosen first.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pyomo.environ as pyo

from .entries import MpccProblem, state_pairs


def _data(leader: int, followers: int, seed: int) -> tuple[Any, ...]:
    """N, M, q and a point with a third of the pairs on each side and a third biactive."""
    random = np.random.default_rng(seed)
    n = random.standard_normal((followers, leader)).round(2)
    root = random.standard_normal((followers, followers)) / np.sqrt(followers)
    skew = random.standard_normal((followers, followers)) / np.sqrt(followers)
    m = (root @ root.T + skew - skew.T + 0.1 * np.eye(followers)).round(2)
    x = random.uniform(0.2, 1.0, leader).round(2)
    kind = np.arange(followers) % 3
    y = np.where(kind == 0, random.uniform(0.5, 2.0, followers).round(2), 0.0)
    w = np.where(kind == 1, random.uniform(0.5, 2.0, followers).round(2), 0.0)
    return random, n, m, w - n @ x - m @ y, x, y, w


def _affine(matrix: Any, variables: Any, rest: Any) -> list[Any]:
    return [
        sum(float(c) * v for c, v in zip(row, variables, strict=True)) + r for row, r in zip(matrix, rest, strict=True)
    ]


def _frame(leader: int, followers: int, seed: int) -> tuple[Any, ...]:
    random, n, m, q, x, y, w = _data(leader, followers, seed)
    model = pyo.ConcreteModel()
    model.x = pyo.Var(range(leader), bounds=(0, 2), initialize=1)
    model.y = pyo.Var(range(followers), bounds=(0, None), initialize=1)
    leading = _affine(n, list(model.x.values()), [float(number) for number in q])
    sides = _affine(m, list(model.y.values()), leading)
    state_pairs(model, [(model.y[i], side) for i, side in enumerate(sides)])
    return model, random, sides, x, y, (n, m, w)


def _planted(leader: int, followers: int, seed: int) -> Any:
    model, _, _, x, y, _ = _frame(leader, followers, seed)
    model.cost = pyo.Objective(
        expr=sum((model.x[i] - float(x[i])) ** 2 for i in model.x)
        + sum((model.y[i] - float(y[i])) ** 2 for i in model.y)
    )
    return model


def _aligned(leader: int, followers: int, seed: int) -> Any:
    """Linear cost ``c x + d y`` plus squares around the point: multipliers of the active sides make it optimal."""
    model, random, _, x, y, (n, m, w) = _frame(leader, followers, seed)
    on_y = np.where(y == 0, random.uniform(0.1, 1.0, followers), 0.0)
    on_side = np.where(w == 0, random.uniform(0.1, 1.0, followers), 0.0)
    c, d = n.T @ on_side, m.T @ on_side + on_y
    model.cost = pyo.Objective(
        expr=sum(float(c[i]) * (model.x[i] - float(x[i])) + (model.x[i] - float(x[i])) ** 2 for i in model.x)
        + sum(float(d[i]) * (model.y[i] - float(y[i])) for i in model.y)
    )
    return model


def _crossed(leader: int, followers: int, seed: int, linear: bool) -> Any:
    """The leader wants large y and small x: what is complementary has to be searched."""
    model, random, _, _, _, _ = _frame(leader, followers, seed)
    c, d = random.uniform(0.1, 1, leader).round(2), random.uniform(-1, 1, followers).round(2)
    cost = sum(float(d[i]) * model.y[i] for i in model.y) + sum(float(c[i]) * model.x[i] for i in model.x)
    if not linear:
        cost = cost + 0.5 * sum(v**2 for v in model.y.values()) + sum((v - 0.5) ** 2 for v in model.x.values())
    else:
        for variable in model.y.values():
            variable.setub(10)
    model.cost = pyo.Objective(expr=cost)
    return model


JIANG_RALPH = "generated; kind of problem: Jiang & Ralph, Comput. Optim. Appl. 13 (1999)"
QPEC = frozenset({"quadratic", "convex", "generated", "biactive"})
PLANTED = ((2, 4, 1), (4, 8, 2), (8, 30, 3), (20, 100, 4), (30, 300, 5))
ALIGNED = ((3, 6, 11), (5, 15, 12), (10, 60, 13), (20, 150, 14))
# (leader, followers, seed): best value, found by branch and bound over the pairs
CROSSED = {
    (2, 4, 21): 1.60035282,
    (3, 6, 22): 1.29574483,
    (4, 8, 23): 1.52510585,
    (5, 10, 24): 0.909237303,
    (4, 12, 25): 1.70441245,
}
CROSSED_LINEAR = {
    (2, 4, 31): -1.06488621,
    (3, 6, 32): -2.28160546,
    (4, 8, 33): -2.60997093,
    (5, 10, 34): -0.630588334,
    (4, 12, 35): -8.56462164,
}


def _point(leader: int, followers: int, seed: int) -> dict[str, float]:
    _, _, _, _, x, y, _ = _data(leader, followers, seed)
    return {f"{name}[{i}]": float(v) for name, values in (("x", x), ("y", y)) for i, v in enumerate(values)}


def _size(followers: int) -> frozenset[str]:
    return frozenset({"large"}) if followers >= 100 else frozenset()


PROBLEMS = (
    *(
        MpccProblem(f"planted qpec {n}x{k}", partial(_planted, n, k, seed), 0.0, tags=QPEC | _size(k),
                    source=JIANG_RALPH, solution=_point(n, k, seed),
                    notes="A third of the pairs is biactive at the solution; the cost is zero there.")
        for n, k, seed in PLANTED
    ),
    *(
        MpccProblem(f"aligned qpec {n}x{k}", partial(_aligned, n, k, seed), 0.0, tags=QPEC | _size(k),
                    source=JIANG_RALPH, solution=_point(n, k, seed),
                    notes="S-stationary with a third of the pairs biactive; all multipliers positive.")
        for n, k, seed in ALIGNED
    ),
    *(
        MpccProblem(f"crossed qpec {n}x{k}", partial(_crossed, n, k, seed, False), best,
                    tags=QPEC - {"biactive"}, source=JIANG_RALPH)
        for (n, k, seed), best in CROSSED.items()
    ),
    *(
        MpccProblem(f"crossed lpec {n}x{k}", partial(_crossed, n, k, seed, True), best,
                    tags=QPEC - {"biactive", "quadratic"} | {"linear"}, source=JIANG_RALPH)
        for (n, k, seed), best in CROSSED_LINEAR.items()
    ),
)  # fmt: skip
