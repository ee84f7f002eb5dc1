"""Agents with quadratic objectives, whose joint optimum is a linear system; builders are at the top level."""

from collections.abc import Sequence

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp


def quadratic(
    matrix: Sequence[Sequence[float]], point: Sequence[float], row: Sequence[float] | None = None
) -> pyo.ConcreteModel:
    """Minimise the distance from a point in the norm of a matrix, on a hyperplane if a row is given."""
    m = pyo.ConcreteModel()
    n = len(point)
    m.v = pyo.Var(range(n), initialize=0.0)
    m.cost = pyo.Objective(
        expr=sum(matrix[i][j] * (m.v[i] - point[i]) * (m.v[j] - point[j]) for i in range(n) for j in range(n)) / 2
    )
    if row is not None:
        m.plane = pyo.Constraint(expr=sum(row[i] * m.v[i] for i in range(n)) == 1.0)
    return m


def middle(n: int) -> pyo.ConcreteModel:
    """A hub with a constraint of its own: the values sum to one."""
    m = pyo.ConcreteModel()
    m.v = pyo.Var(range(n), initialize=0.0)
    m.sum = pyo.Constraint(expr=sum(m.v.values()) == 1.0)
    return m


def random_problems(count: int, n: int, seed: int) -> list[tuple[list[list[float]], list[float]]]:
    """Positive definite matrices and points."""
    random = np.random.default_rng(seed)
    problems = []
    for _ in range(count):
        factor = random.normal(size=(n, n))
        problems.append(((factor @ factor.T + np.eye(n)).tolist(), random.normal(size=n).tolist()))
    return problems


def joint_optimum(problems: list[tuple[list[list[float]], list[float]]]) -> np.ndarray:
    """Where the sum of all objectives is least."""
    total = sum(np.array(matrix) for matrix, _ in problems)
    return np.linalg.solve(total, sum(np.array(matrix) @ point for matrix, point in problems))


def crossing(number: int, count: int, free: bool = False) -> pyo.ConcreteModel:
    """A drone that goes to the other side of a circle; all share how fast they go, and each would rather go at 1."""
    m = pyo.ConcreteModel()
    angle = 2 * np.pi * number / count
    x, y = np.cos(angle), np.sin(angle)
    duration = rcp.Duration(bounds=(1, 9), initial_guess=3) if free else 2.0
    m.me = b = rcp.PhaseBlock(duration=duration, elements=6, scheme="implicit_euler")
    bow = 0.4 + 0.1 * number
    b.x = rcp.State(initial=x, final=-x, initial_guess=lambda t: x * (1 - t) - bow * y * t * (2 - t))
    b.y = rcp.State(initial=y, final=-y, initial_guess=lambda t: y * (1 - t) + bow * x * t * (2 - t))
    b.u, b.v = rcp.Control(), rcp.Control()
    b.ode(lambda b, t: {b.x: b.u[t], b.y: b.v[t]})
    m.pace = pyo.Var(initialize=1.0)
    effort = b.integral(lambda b, t: b.u[t] ** 2 + b.v[t] ** 2)
    m.cost = pyo.Objective(expr=effort + (m.pace - number) ** 2 + (b.duration if free else 0.0))
    return m
