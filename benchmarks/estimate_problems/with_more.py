"""Smooth problems with algebraics, parameters, data, and several phases."""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp


def bead_on_a_wire(**how):
    """A bead on a parabola, with the force of the wire as an algebraic variable."""
    m = pyo.ConcreteModel(name="bead on a wire")
    m.p = b = rcp.PhaseBlock(duration=1.5, **how)
    b.x, b.v = rcp.State(initial=0, final=1), rcp.State(initial=0, final=0)
    b.force, b.push = rcp.Algebraic(initial_guess=1.0), rcp.Control()
    # Height x^2, slope 2 x: the wire pushes at a right angle to itself.
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.push[t] - 2 * b.x[t] * b.force[t]})
    b.residual(lambda b, t: 2 * b.v[t] ** 2 + 2 * b.x[t] * (b.push[t] - 2 * b.x[t] * b.force[t]) == b.force[t] - 9.81)
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.push[t] ** 2 + 0.01 * b.force[t] ** 2))
    return m


def fitted_decay(**how):
    """Two rates of a chain of reactions from measurements of its middle."""
    m = pyo.ConcreteModel(name="fitted decay")
    m.p = b = rcp.PhaseBlock(duration=4.0, **how)
    b.a, b.c = rcp.State(initial=1, initial_guess=1), rcp.State(initial=0)
    b.k = rcp.Parameter(index=2, bounds=(0.05, 20), initial_guess=1)
    b.ode(lambda b, t: {b.a: -b.k[0] * b.a[t], b.c: b.k[0] * b.a[t] - b.k[1] * b.c[t] ** 2})
    wanted = lambda t: 0.9 * t * pyo.exp(-t) + 0.05 * pyo.sin(3 * t)  # noqa: E731
    m.misfit = pyo.Objective(expr=b.integral(lambda b, t: (b.c[t] - wanted(t)) ** 2))
    return m


def tuned_spring(**how):
    """The best stiffness for a motion that the control leads, in a free time."""
    m = pyo.ConcreteModel(name="tuned spring")
    m.p = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.5, 10), initial_guess=2), **how)
    b.x, b.v = rcp.State(initial=0, final=1), rcp.State(initial=0, final=0)
    b.k, b.u = rcp.Parameter(bounds=(0.1, 10), initial_guess=1), rcp.Control()
    b.initialize_straight_lines()
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - b.k * b.x[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 + 0.1) + 0.05 * b.duration * b.k)
    return m


def tracking(**how):
    """A motor that follows a signal of time against a load of time."""
    m = pyo.ConcreteModel(name="tracking")
    m.p = b = rcp.PhaseBlock(duration=4.0, **how)
    b.x, b.v, b.u = rcp.State(initial=0), rcp.State(initial=0), rcp.Control()
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - b.v[t] - 0.5 * pyo.cos(2 * t)})
    m.cost = pyo.Objective(
        expr=b.integral(lambda b, t: 10 * (b.x[t] - pyo.sin(t) * pyo.exp(-0.2 * t)) ** 2 + b.u[t] ** 2)
    )
    return m


def table_of_wind(**how):
    """A glider of one state against a wind that a smooth table gives."""
    m = pyo.ConcreteModel(name="table of wind")
    m.p = b = rcp.PhaseBlock(duration=2.0, **how)
    height = np.linspace(0.0, 3.0, 7)
    wind = rcp.Table(height, np.sin(height) + 0.2 * height, kind="quintic")
    b.z, b.u = rcp.State(initial=0.5, final=2.0, bounds=(0, 3)), rcp.Control()
    b.ode(lambda b, t: {b.z: b.u[t] - wind(b.z[t])})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m


def two_linked(**how):
    """A mass that loses a half of itself, each phase as long as it wants."""
    m = pyo.ConcreteModel(name="two linked phases")
    for name, mass in (("heavy", 2.0), ("light", 1.0)):
        b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 5), initial_guess=1), **how)
        m.add_component(name, b)
        _mover(b, mass)
    m.heavy.x[m.heavy.initial_time].fix(0.0)
    m.heavy.v[m.heavy.initial_time].fix(0.0)
    m.light.x[m.light.final_time].fix(2.0)
    m.light.v[m.light.final_time].fix(0.0)
    m.drop = rcp.Link(m.heavy, m.light)
    m.cost = pyo.Objective(expr=sum(b.integral(lambda b, t: b.u[t] ** 2 + 0.5) for b in (m.heavy, m.light)))
    return m


def _mover(b, mass):
    b.x, b.v, b.u = rcp.State(initial_guess=1), rcp.State(initial_guess=1), rcp.Control()
    b.ode(lambda b, t: {b.x: b.v[t], b.v: (b.u[t] - 0.3 * b.v[t] ** 2) / mass})


def by_parts(**how):
    """The integrator in two phases; the objective is the square root of both costs, one of them below a bound."""
    m = pyo.ConcreteModel(name="by parts")
    m.first, m.second = (rcp.PhaseBlock(duration=1.5, **how) for _ in range(2))
    for b in (m.first, m.second):
        b.x, b.u = rcp.State(), rcp.Control()
        b.ode(lambda b, t: {b.x: b.u[t]})
    m.first.x[0].fix(1.0)
    m.meet = pyo.Constraint(expr=m.first.x[1.5] == m.second.x[0])
    m.bound = pyo.Var(initialize=1.0)
    m.costs = [b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2) for b in (m.first, m.second)]
    m.spent = pyo.Constraint(expr=m.costs[1] <= m.bound)
    m.cost = pyo.Objective(expr=pyo.sqrt(m.costs[0] + m.bound))
    return m
