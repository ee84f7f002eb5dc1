"""Masses on wires, on tracks and in valleys."""

from __future__ import annotations

from math import radians

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp


def brachistochrone_above_slope(mesh=None, elements=None):
    """The quickest slide that stays above a slope: Betts 2010, example 4.10, in feet."""
    m = pyo.ConcreteModel(name="brachistochrone above a slope")
    m.slide = b = rcp.PhaseBlock(
        duration=rcp.Duration(bounds=(0.01, 10), initial_guess=1), mesh=mesh, elements=elements
    )
    b.x, b.y = rcp.State(initial=0, final=1), rcp.State(initial=0, initial_guess=lambda s: 0.5 * s)
    b.v = rcp.State(initial=0, initial_guess=lambda s: 5 * s)
    b.angle = rcp.Control(initial_guess=0.5)
    b.initialize_straight_lines()

    @b.ode
    def slide(b, t):
        sine, cosine = pyo.sin(b.angle[t]), pyo.cos(b.angle[t])
        return {b.x: b.v[t] * cosine, b.y: b.v[t] * sine, b.v: 32.174 * sine}

    b.constraint(lambda b, t: b.y[t] <= b.x[t] / 2 + 0.1)
    m.time_taken = pyo.Objective(expr=b.duration)
    return m


def short_wire(mesh=None, elements=None):
    """A brachistochrone on a wire of 11.9 m at most: the length-constrained brachistochrone of dymos, 2021."""
    m = pyo.ConcreteModel(name="brachistochrone on a short wire")
    m.slide = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.5, 10), initial_guess=2), mesh=mesh, elements=elements)
    b.x, b.y = rcp.State(initial=0, final=10), rcp.State(initial=10, final=5)
    b.v = rcp.State(initial=0, initial_guess=lambda s: 9.9 * s)
    b.angle = rcp.Control(
        bounds=(radians(0.01), radians(179.9)), initial_guess=lambda s: radians(5) + s * (radians(100) - radians(5))
    )
    b.initialize_straight_lines()

    @b.ode
    def slide(b, t):
        sine, cosine = pyo.sin(b.angle[t]), pyo.cos(b.angle[t])
        return {b.x: b.v[t] * sine, b.y: -b.v[t] * cosine, b.v: 9.80665 * cosine}

    m.length = pyo.Constraint(expr=b.integral(lambda b, t: b.v[t]) <= 11.9)
    m.time_taken = pyo.Objective(expr=b.duration)
    return m


def pendulum(mesh=None, elements=None):
    """Bring a pendulum to rest, in Cartesian coordinates: Bueskens & Gerdts 2000; Betts 2010."""
    m = pyo.ConcreteModel(name="pendulum as a multibody system")
    m.swing = b = rcp.PhaseBlock(duration=3, mesh=mesh, elements=elements)
    b.r = rcp.State(index=2, initial=[1, 0], final=[0, None])
    b.v = rcp.State(index=2, initial=0, final=[0, None])
    b.tension = rcp.Algebraic()
    b.u = rcp.Control()

    @b.ode
    def swing(b, t):
        (x, y), tension, u = b.r[t], b.tension[t], b.u[t]
        return {b.r: b.v[t], b.v: [-2 * tension * x + u * y, -9.81 - 2 * tension * y - u * x]}

    b.residual(lambda b, t: b.v[t] @ b.v[t] - 2 * b.tension[t] - 9.81 * b.r[1, t] == 0)
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m


def path_tracking(mesh=None, elements=None):
    """A robot follows a path with a corner, in two phases: the manuals of PROPT and PSOPT."""
    m = pyo.ConcreteModel(name="two-phase path tracking")
    ends = ([0, 0, 0.5, 0], [0.25, 0.25, 0.25, 0.25], [0.5, 0.5, 0, 0.5])
    costs = []
    for k, name in enumerate(("along", "across")):
        b = rcp.PhaseBlock(duration=1, mesh=mesh and mesh[name], elements=elements)
        m.add_component(name, b)
        fixed = {"initial": ends[0]} if k == 0 else {"final": ends[2]}
        first, last = ends[k], ends[k + 1]
        line = [lambda s, a=a, c=c: a + (c - a) * s for a, c in zip(first, last, strict=True)]
        b.x = rcp.State(index=4, bounds=(-10, 10), initial_guess=line, **fixed)
        b.u = rcp.Control(index=2, bounds=(-10, 10))
        b.ode(lambda b, t: {b.x: [b.x[2, t], b.x[3, t], b.u[0, t], b.u[1, t]]})

        def miss(b, t, k=k):
            x, y, v, w = b.x[t]
            here = (t / 2, 0, 0.5, 0) if k == 0 else (0.5, t / 2, 0, 0.5)
            return 100 * ((x - here[0]) ** 2 + (y - here[1]) ** 2) + 500 * ((v - here[2]) ** 2 + (w - here[3]) ** 2)

        costs.append(b.integral(miss))
    m.corner = rcp.Link(m.along, m.across)
    m.misses = pyo.Objective(expr=sum(costs))
    return m


def coulomb_friction(mesh=None, elements=None):
    """Two masses with smoothed friction in the shortest time: Driessen & Sadegh 2000; the manual of PSOPT."""
    m = pyo.ConcreteModel(name="Coulomb friction")
    m.move = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(1.8, 4), initial_guess=4), mesh=mesh, elements=elements)
    b.q = rcp.State(index=2, initial=0, final=[1, 2], bounds=(-2, 2))
    b.v = rcp.State(index=2, initial=[-1, -2], final=0, bounds=(-20, 20))
    b.u = rcp.Control(index=2, bounds=(-4, 4))
    b.initialize_straight_lines()

    @b.ode
    def masses(b, t):
        (q, r), v, (u, w) = b.q[t], b.v[t], b.u[t]
        friction = [rate / pyo.sqrt(rate**2 + 0.01**2) for rate in v]
        first = (-(0.95 + 0.85) * q + 0.85 * r - friction[0] + u) / 1.1
        return {b.q: v, b.v: [first, (0.85 * q - 0.85 * r - friction[1] + w) / 1.2]}

    m.time_taken = pyo.Objective(expr=b.duration)
    return m


def mountain_car(mesh=None, elements=None):
    """A weak car rocks itself out of a valley: Moore 1990; Melnikov et al. 2014; an example of dymos."""
    m = pyo.ConcreteModel(name="mountain car")
    time = rcp.Duration(bounds=(0.05, 10000), initial_guess=500)
    m.ride = b = rcp.PhaseBlock(duration=time, mesh=mesh, elements=elements)
    b.x = rcp.State(initial=-0.5, final=0.5, bounds=(-1.2, 0.5))
    b.v = rcp.State(initial=0, final=(0, None), bounds=(-0.07, 0.07), initial_guess=lambda s: 0.07 * s)
    b.u = rcp.Control(bounds=(-1, 1), initial_guess=lambda s: s)
    b.initialize_straight_lines()
    b.ode(lambda b, t: {b.x: b.v[t], b.v: 0.001 * b.u[t] - 0.0025 * pyo.cos(3 * b.x[t])})
    m.time_taken = pyo.Objective(expr=b.duration)
    return m


def farthest_in_a_second(mesh=None, elements=None):
    """A double integrator as far as possible to rest: the double integrator of dymos, 2021; a quarter, exactly."""
    m = pyo.ConcreteModel(name="double integrator as far as possible")
    m.move = b = rcp.PhaseBlock(duration=1, mesh=mesh, elements=elements)
    b.x, b.v = rcp.State(initial=0, initial_guess=lambda s: 0.25 * s), rcp.State(initial=0, final=0)
    b.u = rcp.Control(bounds=(-1, 1), initial_guess=lambda s: 1 - 2 * s)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
    m.distance = pyo.Objective(expr=b.x[b.final_time], sense=pyo.maximize)
    return m
