"""Quadratic optimal control of linear complementarity systems: the six published problems with numbers.

``x' = A x + B v + F u`` with ``0 <= v  _|_  w = C x + D v + E u >= 0``, and the least integral of ``|x|^2 + r |u|^2``.
The pairs are part of the dynamics, and the control may move them from one branch to the other at any time. In ``7`` the
feedback passes through a chain of three integrators over ten seconds.

Vieira, Brogliato & Prieur, Quadratic optimal control of linear complementarity systems: first-order necessary
conditions and numerical analysis, IEEE Trans. Automatic Control 65 (2020), doi:10.1109/TAC.2019.2945878
"""

from __future__ import annotations

from dataclasses import dataclass

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp


@dataclass(frozen=True)
class Problem:
    """Matrices by rows, one column per state, multiplier or control; weight of ``|u|^2``; seconds and steps."""

    start: tuple[float, ...]
    a: list[list[float]]
    b: list[list[float]]
    f: list[list[float]]
    c: list[list[float]]
    d: list[list[float]]
    e: list[list[float]]
    weight: float = 1.0
    duration: float = 1.0
    elements: int = 1000


PROBLEMS = {
    "1": Problem((1,), a=[[3]], b=[[-0.5]], f=[[3]], c=[[0]], d=[[1]], e=[[-2]]),
    "2": Problem((-0.5, 1), a=[[0, 1], [0, 0]], b=[[-1], [1]], f=[[0], [1]], c=[[-1, 1]], d=[[0]], e=[[1]]),
    "3": Problem(
        (-0.5, 1),
        a=[[1, 2], [2, 1]],
        b=[[-1, 1], [-1, 1]],
        f=[[1, 3], [2, 1]],
        c=[[3, -1], [-2, 0]],
        d=[[1, 0], [0, 1]],
        e=[[1, -1], [-1, 2]],
        weight=25.0,
    ),
    "4": Problem((-0.5, -1), a=[[5, -6], [3, 9]], b=[[4], [5]], f=[[0], [-4]], c=[[1, 5]], d=[[1]], e=[[6]]),
    "6": Problem((-0.5, -1), a=[[1, -3], [-8, 10]], b=[[-3], [-1]], f=[[4], [8]], c=[[1, -3]], d=[[5]], e=[[3]]),
    "7": Problem(
        (-2, 1, -1),
        a=[[0, 1, 0], [0, 0, 1], [0, 0, 0]],
        b=[[0], [0], [1]],
        f=[[0], [0], [1]],
        c=[[1, 0, 0]],
        d=[[0]],
        e=[[1]],
        duration=10.0,
        elements=10000,
    ),
}


def build(case: str = "1", elements: int | None = None) -> pyo.ConcreteModel:
    """One of the problems, by implicit Euler as published."""
    problem = PROBLEMS[case]
    m = pyo.ConcreteModel(name="linear complementarity control")
    m.run = b = rcp.PhaseBlock(
        duration=problem.duration, elements=elements or problem.elements, scheme="implicit_euler"
    )
    states = [f"x{i + 1}" for i in range(len(problem.a))]
    controls = [f"u{i + 1}" for i in range(len(problem.f[0]))]
    multipliers = [f"v{i + 1}" for i in range(len(problem.c))]
    gaps = [f"w{i + 1}" for i in range(len(problem.c))]
    for name, start in zip(states, problem.start, strict=True):
        b.declare(name, rcp.State(initial=start))
    for name in controls:
        b.declare(name, rcp.Control())
    for name in (*multipliers, *gaps):
        b.declare(name, rcp.Algebraic(bounds=(0, None)))

    def at(b, t, names):
        return [getattr(b, name)[t] for name in names]

    @b.ode
    def linear_system(b, t):
        x, v, u = (at(b, t, names) for names in (states, multipliers, controls))
        rows = zip(states, problem.a, problem.b, problem.f, strict=True)
        return {
            getattr(b, name): combined(of_x, x) + combined(of_v, v) + combined(of_u, u)
            for name, of_x, of_v, of_u in rows
        }

    @b.residual
    def gap(b, t):
        x, v, u, w = (at(b, t, names) for names in (states, multipliers, controls, gaps))
        rows = zip(w, problem.c, problem.d, problem.e, strict=True)
        return [left == combined(c, x) + combined(d, v) + combined(e, u) for left, c, d, e in rows]

    @b.complementarity
    def one_of_them_is_zero(b, t):
        return [rcp.complements(v >= 0, w >= 0) for v, w in zip(at(b, t, multipliers), at(b, t, gaps), strict=True)]

    def cost(b, t):
        return sum(x**2 for x in at(b, t, states)) + problem.weight * sum(u**2 for u in at(b, t, controls))

    m.cost = pyo.Objective(expr=b.integral(cost))
    return m


def combined(coefficients: list[float], variables: list) -> object:
    """A row times a column, without the terms that are zero."""
    return sum(factor * variable for factor, variable in zip(coefficients, variables, strict=True) if factor)


def draw(figure, m: pyo.ConcreteModel) -> None:
    """States, controls, and both sides of the pairs."""
    trajectory = m.run.trajectory()
    trajectory.plot([*trajectory.states, *trajectory.signals], figure=figure)
    figure.suptitle(m.name)


if __name__ == "__main__":
    from run_example import run_example

    cases = {name: {"case": name} for name in PROBLEMS}
    run_example(build, draw, cases=cases, default="6", coarse={"elements": 20}, size=(7, 6))
