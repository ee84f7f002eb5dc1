"""The same problems as in `problem_styles`, stated with this package."""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from . import problem_styles


def phase(duration=1.0, elements=None, mesh=None, start=0.0, scheme="implicit_euler"):
    m = pyo.ConcreteModel()
    m.phase = rcp.PhaseBlock(duration=duration, elements=elements, mesh=mesh, start=start, scheme=scheme)
    return m, m.phase


def minimise(m, integrand, final=0.0):
    m.cost = pyo.Objective(expr=m.phase.integral(integrand) + final)
    return m


def pendulum(scheme="implicit_euler"):
    m, b = phase(3.0, 12, scheme=scheme)
    b.a, b.w = rcp.State(initial=0, bounds=(-2 * np.pi, 2 * np.pi)), rcp.State(initial=0, bounds=(-10, 10))
    b.u = rcp.Control(bounds=(-10, 10))
    b.ode(lambda b, t: {b.a: b.w[t], b.w: (b.u[t] - 9.81 * pyo.sin(b.a[t]) - 0.1 * b.w[t]) / 2})
    return minimise(m, lambda b, t: (b.a[t] - np.pi) ** 2 + b.w[t] ** 2 + 0.01 * b.u[t] ** 2)


def explicit_pendulum():
    return pendulum("explicit_euler")


def midpoint_pendulum():
    return pendulum("implicit_midpoint")


def quick_cart():
    m, b = phase(rcp.Duration(bounds=(0.1, 10), initial_guess=3), 10)
    b.x, b.v = rcp.State(initial=0, final=1, bounds=(-2, 2)), rcp.State(initial=0, final=0)
    b.u = rcp.Control(bounds=(-1, 1))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
    m.cost = pyo.Objective(expr=b.duration)
    return m


def parameter_curve():
    m, b = phase(1.0, 8)
    b.x, b.u, b.p = rcp.State(initial=0.5), rcp.Control(), rcp.Parameter()
    b.ode(lambda b, t: {b.x: b.u[t] - b.x[t]})
    final = (b.x[1] - 1) ** 2 + 0.1 * b.x[0] + 0.1 * b.x[0.125] + b.x[1] * b.p
    return minimise(m, lambda b, t: b.u[t] ** 2 + (b.p - t) ** 2, final)


def one_sided():
    m, b = phase(1.0, 12)
    b.x, b.u, b.v, b.w = rcp.State(initial=1), rcp.Control(), rcp.Algebraic(bounds=(0, None)), rcp.Algebraic()
    b.ode(lambda b, t: {b.x: 3 * b.x[t] - 0.5 * b.v[t] + 3 * b.u[t]})

    @b.residual
    def gap(b, t):
        return b.w[t] == b.v[t] - 2 * b.u[t]

    @b.complementarity
    def contact(b, t):
        return rcp.complements(b.w[t] >= 0, b.v[t] >= 0)

    return minimise(m, lambda b, t: b.x[t] ** 2 + b.u[t] ** 2)


def dead_zone():
    m, b = phase(2.0, 12)
    b.x, b.v, b.u = rcp.State(initial=0), rcp.State(initial=0), rcp.Control(bounds=(-3, 3))
    b.force = rcp.Algebraic(bounds=(0, None))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - b.force[t]})
    gap = {t: 0.5 if i < 6 else 0.8 for i, t in enumerate(b.points)}

    @b.complementarity
    def play(b, t):
        return rcp.complements(b.force[t] >= 0, b.x[t] <= gap[t])

    return minimise(m, lambda b, t: (b.x[t] - 1) ** 2 + b.v[t] ** 2 + 0.1 * b.u[t] ** 2)


def mode_sequence():
    one, two = np.linspace(0, 1, 6), np.linspace(0, 1, 6) ** 1.2
    m = pyo.ConcreteModel()
    lasts = rcp.Duration(bounds=(0.1, 5), initial_guess=1)
    for name, mesh in (("first", one), ("second", two)):
        m.add_component(name, rcp.PhaseBlock(duration=lasts, mesh=mesh, scheme="implicit_euler"))
    for b in (m.first, m.second):
        b.x = rcp.State(initial=0 if b is m.first else None, final=None if b is m.first else 2)
        b.v = rcp.State(initial=0 if b is m.first else None, final=None if b is m.first else 0)
        b.u = rcp.Control(bounds=(-1, 1))
    m.link = rcp.Link(m.first, m.second)
    m.first.ode(lambda b, t: {b.x: b.v[t], b.v: 2 * b.u[t] - 0.5 * b.v[t]})
    m.second.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - b.x[t]})
    effort = sum(b.integral(lambda b, t: 0.1 * b.u[t] ** 2) for b in (m.first, m.second))
    m.cost = pyo.Objective(expr=effort + m.first.duration + m.second.duration)
    return m


def learned_friction():
    learned = problem_styles.LearnedFriction()
    m, b = phase(1.5, 8)
    b.x, b.v, b.u = rcp.State(initial=0), rcp.State(initial=0), rcp.Control(bounds=(-3, 3))

    @b.ode
    def motion(b, t):
        z = (pyo.sin(b.x[t]), b.v[t], b.u[t])
        friction = sum(
            weight * pyo.exp(-0.5 * sum(((zi - xi) / s) ** 2 for zi, xi, s in zip(z, x, learned.scale, strict=True)))
            for weight, x in zip(learned.weights, learned.X, strict=True)
        )
        return {b.x: b.v[t], b.v: b.u[t] - friction}

    return minimise(m, lambda b, t: (b.x[t] - 1) ** 2 + 0.1 * b.v[t] ** 2 + 0.02 * (pyo.cosh(b.u[t]) - 1))


def arm():
    m, b = phase(1.0, 6)
    for name, goal in (("q1", 1.0), ("q2", -0.5), ("w1", 0), ("w2", 0)):
        b.declare(name, rcp.State(initial=0, final=goal))
    b.u1, b.u2 = rcp.Control(bounds=(-20, 20)), rcp.Control(bounds=(-20, 20))

    @b.ode
    def motion(b, t):
        c, s = pyo.cos(b.q2[t]), pyo.sin(b.q2[t])
        left = b.u1[t] + s * b.w2[t] * (2 * b.w1[t] + b.w2[t])
        right = b.u2[t] - s * b.w1[t] ** 2
        determinant = (3 + 2 * c) - (1 + c) ** 2
        return {
            b.q1: b.w1[t],
            b.q2: b.w2[t],
            b.w1: (left - (1 + c) * right) / determinant,
            b.w2: ((3 + 2 * c) * right - (1 + c) * left) / determinant,
        }

    return minimise(m, lambda b, t: 0.01 * (b.u1[t] ** 2 + b.u2[t] ** 2) + b.w1[t] ** 2 + b.w2[t] ** 2)


def coupled_masses():
    m, b = phase(1.0, mesh=-1.0 + np.linspace(0, 1, 13) ** 1.5, start=-1.0)
    b.x, b.z = rcp.State(initial=1, derivative_bounds=(-9, 9)), rcp.State(initial=-1, derivative_bounds=(-9, 9))
    b.force, b.u = rcp.Algebraic(bounds=(-9, 9)), rcp.Control(bounds=(-2, 2))

    def pulls(b, t):
        return b.u[t] + pyo.sin(3 * t), b.force[t]

    @b.ode
    def motion(b, t):
        first, second = pulls(b, t)
        return {b.x: (3 * first - second) / 5, b.z: (2 * second - first) / 5}

    @b.residual
    def friction(b, t):
        first, second = pulls(b, t)
        return b.force[t] + 2 * b.z[t] - b.x[t] * (3 * first - second) / 5

    def cost(b, t):
        first, second = pulls(b, t)
        rate = (3 * first - second) / 5
        return b.x[t] ** 2 + b.z[t] ** 2 + b.u[t] ** 2 + 0.1 * rate**2 + 0.1 * b.force[t] ** 2

    return minimise(m, cost)


def rolling_ball():
    m, b = phase(1.0, 10)
    b.x = rcp.State(initial=0, bounds=(-5, 5), derivative_bounds=(0.1, 5))
    b.u = rcp.Control(bounds=(-5, 5), initial_guess=1)

    @b.residual
    def rolling(b, t):
        return b.derivative(b.x)[t] ** 2 * pyo.exp(0.2 * b.x[t]) == 1 + b.u[t]

    b.initialize(x_derivative=1.0)
    return minimise(m, lambda b, t: (b.x[t] - t) ** 2 + 0.1 * b.u[t] ** 2 + 0.1 * (1 + b.u[t]) * pyo.exp(-0.2 * b.x[t]))


def corridor():
    m, b = phase(4.0, 8)
    centre = {t: np.sin(2 * np.pi * i / 8) for i, t in enumerate(b.points)}
    fastest = {t: 1.5 if i % 4 else 0.6 for i, t in enumerate(b.points)}
    b.x, b.v, b.u = rcp.State(initial=0), rcp.State(initial=0), rcp.Control(bounds=(-20, 20))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - 0.2 * b.v[t]})

    @b.constraint
    def walls(b, t):
        last = 0.0 if t == 4.0 else centre[t]  # the bounds of the last index hold at the end too
        return [
            (max(centre[t], last) - 0.8, b.x[t], min(centre[t], last) + 0.8),
            (-fastest[t], b.v[t], fastest[t]),
        ]

    return minimise(m, lambda b, t: 0.01 * b.u[t] ** 2 + b.v[t] ** 2)


def car(centres=problem_styles.Car.centres):
    m, b = phase(5.0, 20)
    for name, goal in (("x", 3), ("y", 3), ("a", np.pi / 2), ("v", 0)):
        b.declare(name, rcp.State(initial=0, final=goal))
    b.steer, b.push = rcp.Control(bounds=(-np.pi / 3, np.pi / 3)), rcp.Control(bounds=(-10, 10))

    @b.ode
    def motion(b, t):
        return {
            b.x: b.v[t] * pyo.sin(b.a[t]),
            b.y: b.v[t] * pyo.cos(b.a[t]),
            b.a: b.steer[t] * b.v[t],
            b.v: b.push[t],
        }

    angle = np.pi / 2 / 5.0
    b.initialize(x=lambda t: 3 - 3 * np.cos(angle * t), y=lambda t: 3 * np.sin(angle * t), v=1.0)
    b.avoid = rcp.ObstacleAvoidanceBlock(
        b.time,
        bodies={"car": rcp.Body(rcp.Polytope.box(0.5, 0.5), lambda b, t: rcp.planar_pose(b.x[t], b.y[t], -b.a[t]))},
        obstacles=[rcp.Polytope.box(1, 1, center=centre) for centre in centres],
        clearance=0.02,
    )
    return minimise(
        m,
        lambda b, t: (
            (b.x[t] - 3) ** 2
            + (b.y[t] - 3) ** 2
            + (b.a[t] - np.pi / 3) ** 2
            + b.v[t] ** 2
            + b.steer[t] ** 2
            + b.push[t] ** 2
        ),
    )
