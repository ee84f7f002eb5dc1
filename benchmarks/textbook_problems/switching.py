"""Small mechanics: controls that jump, chatter or are singular, a state that touches its limit, a hilly road."""

from __future__ import annotations

from math import pi

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp


def chattering(mesh=None, elements=None):
    """Fuller's problem in unit time, with ever shorter intervals: Sager 2005; mintOC.de, the relaxed problem."""
    m = pyo.ConcreteModel(name="Fuller's problem")
    m.p = b = rcp.PhaseBlock(duration=1, mesh=mesh, elements=elements)
    b.x, b.v = rcp.State(initial=0.01, final=0.01), rcp.State(initial=0, final=0)
    b.w = rcp.Control(bounds=(0, 1), initial_guess=0.5)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: 1 - 2 * b.w[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2))
    return m


def triple_integrator(mesh=None, elements=None):
    """A singular arc of third order: Luus, Iterative Dynamic Programming, 2000, sec. 10.2; the manual of PROPT."""
    m = pyo.ConcreteModel(name="singular triple integrator")
    m.p = b = rcp.PhaseBlock(duration=5, mesh=mesh, elements=elements)
    b.x = rcp.State(index=3, initial=[1, 0, 0])
    b.u = rcp.Control(bounds=(-1, 1))
    b.ode(lambda b, t: {b.x: [b.x[1, t], b.x[2, t], b.u[t]]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[0, t] ** 2))
    return m


def singular_oscillator(mesh=None, elements=None):
    """Van der Pol's oscillator, bang and singular: Vossen, JOTA 144 (2010) 409, doi:10.1007/s10957-009-9589-z."""
    m = pyo.ConcreteModel(name="van der Pol with a singular arc")
    m.p = b = rcp.PhaseBlock(duration=4, mesh=mesh, elements=elements)
    b.x, b.v = rcp.State(initial=0), rcp.State(initial=1)
    b.u = rcp.Control(bounds=(-1, 1))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: -b.x[t] + b.v[t] * (1 - b.x[t] ** 2) + b.u[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.x[t] ** 2 + b.v[t] ** 2) / 2))
    return m


def oscillator_to_rest(mesh=None, elements=None):
    """Quickly, from five times what the force holds: Pontryagin et al., Theory of Optimal Processes, 1962, sec. 5."""
    m = pyo.ConcreteModel(name="oscillator in minimum time")
    m.p = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 50), initial_guess=5), mesh=mesh, elements=elements)
    b.x, b.v = rcp.State(initial=5, final=0), rcp.State(initial=0, final=0)
    b.u = rcp.Control(bounds=(-1, 1))
    b.initialize_straight_lines()
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - b.x[t]})
    m.time_taken = pyo.Objective(expr=b.duration)
    return m


def two_masses(mesh=None, elements=None):
    """Move two masses and the spring between them, three switches: Liu & Wie, J. Guidance 15 (1992) 597: 4.218."""
    m = pyo.ConcreteModel(name="two masses and a spring")
    m.p = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 50), initial_guess=5), mesh=mesh, elements=elements)
    b.x = rcp.State(index=2, initial=0, final=1)
    b.v = rcp.State(index=2, initial=0, final=0)
    b.u = rcp.Control(bounds=(-1, 1))
    b.initialize_straight_lines()

    @b.ode
    def masses(b, t):
        pull = b.x[1, t] - b.x[0, t]
        return {b.x: b.v[t], b.v: [b.u[t] + pull, -pull]}

    m.time_taken = pyo.Objective(expr=b.duration)
    return m


def turn_around(mesh=None, elements=None):
    """To the same place, facing back, in curves of unit radius: Dubins, Amer. J. Math. 79 (1957) 497; 7 pi / 3."""
    m = pyo.ConcreteModel(name="turn of a car that only moves forward")
    m.p = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 50), initial_guess=pi), mesh=mesh, elements=elements)
    b.r = rcp.State(index=2, initial=0, final=0)
    b.heading = rcp.State(initial=0, final=pi)
    b.u = rcp.Control(bounds=(-1, 1))
    b.initialize_straight_lines()
    b.ode(lambda b, t: {b.r: [pyo.cos(b.heading[t]), pyo.sin(b.heading[t])], b.heading: b.u[t]})
    m.length = pyo.Objective(expr=b.duration)
    return m


def third_order_limit(mesh=None, elements=None):
    """A limit of third order, touched again and again: Robbins, JOTA 31 (1980) 361; BOCOP, also the guess."""
    m = pyo.ConcreteModel(name="Robbins' problem")
    m.p = b = rcp.PhaseBlock(duration=10, mesh=mesh, elements=elements)
    b.x = rcp.State(initial=1, final=0, bounds=(0, None), initial_guess=0.1)
    b.v, b.a = rcp.State(initial=-2, final=0, initial_guess=0.1), rcp.State(initial=0, final=0, initial_guess=0.1)
    b.u = rcp.Control(initial_guess=0.1)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.a[t], b.a: b.u[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: 3 * b.x[t] + 0.5 * b.u[t] ** 2))
    return m


def electric_vehicle(mesh=None, elements=None):
    """Over a hilly road with the least energy: Petit & Sciarretta 2011, doi:10.3182/20110828-6-IT-1002.01560."""
    m = pyo.ConcreteModel(name="electric vehicle")
    m.drive = b = rcp.PhaseBlock(duration=1, mesh=mesh, elements=elements)
    b.x, b.v = rcp.State(initial=0, final=10), rcp.State(initial=0, final=0)
    b.u = rcp.Control()
    b.initialize_straight_lines()

    @b.ode
    def vehicle(b, t):
        x, v = b.x[t], b.v[t]
        slope = 3 + 0.4 * x - x**2 + 0.1 * x**3
        return {b.x: v, b.v: b.u[t] - 1e-3 * v**2 - 0.1 - slope}

    m.energy = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] * b.v[t] + b.u[t] ** 2))
    return m


def largest_area(mesh=None, elements=None):
    """Dido's problem: the largest area between a coast and a rope of length pi; a half disc, pi / 2."""
    m = pyo.ConcreteModel(name="Dido's problem")
    m.rope = b = rcp.PhaseBlock(duration=pi, mesh=mesh, elements=elements)
    b.x, b.y = rcp.State(initial=0), rcp.State(initial=0, final=0)
    b.direction = rcp.Control(bounds=(-pi, pi))
    b.ode(lambda b, t: {b.x: pyo.cos(b.direction[t]), b.y: pyo.sin(b.direction[t])})
    m.area = pyo.Objective(expr=b.integral(lambda b, t: b.y[t] * pyo.cos(b.direction[t])), sense=pyo.maximize)
    return m
