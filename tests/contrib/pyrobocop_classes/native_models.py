"""The same problems as in `problems`, stated with this package."""

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp


def phase(duration=1.0, elements=None, mesh=None, start=0.0, scheme="implicit_euler"):
    m = pyo.ConcreteModel()
    m.phase = rcp.PhaseBlock(duration=duration, elements=elements, mesh=mesh, start=start, scheme=scheme)
    return m, m.phase


def minimise(m, integrand, final=0.0):
    m.cost = pyo.Objective(expr=m.phase.integral(integrand) + final)
    return m


def pendulum(scheme):
    m, b = phase(3.0, 12, scheme=scheme)
    b.a, b.w = rcp.State(initial=0, bounds=(-2 * np.pi, 2 * np.pi)), rcp.State(initial=0, bounds=(-10, 10))
    b.u = rcp.Control(bounds=(-10, 10))
    b.ode(lambda b, t: {b.a: b.w[t], b.w: (b.u[t] - 9.81 * pyo.sin(b.a[t]) - 0.1 * b.w[t]) / 2})
    return minimise(m, lambda b, t: (b.a[t] - np.pi) ** 2 + b.w[t] ** 2 + 0.01 * b.u[t] ** 2)
