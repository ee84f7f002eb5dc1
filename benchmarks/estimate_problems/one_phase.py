"""Smooth problems in one phase, most of them of textbooks."""

from __future__ import annotations

from math import pi

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp


def integrator(**how):
    """Position and speed squared, for three seconds: tanh 3."""
    m = pyo.ConcreteModel(name="integrator")
    m.p = b = rcp.PhaseBlock(duration=3.0, **how)
    b.x, b.u = rcp.State(initial=1), rcp.Control()
    b.ode(lambda b, t: {b.x: b.u[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2))
    return m


def unstable_regulator(**how):
    """With a pole at one, and the cost as a state."""
    m = pyo.ConcreteModel(name="unstable regulator")
    m.p = b = rcp.PhaseBlock(duration=2.0, **how)
    b.x, b.u, b.spent = rcp.State(initial=1), rcp.Control(), rcp.State(initial=0)
    b.ode(lambda b, t: {b.x: b.u[t] + b.x[t], b.spent: b.x[t] ** 2 + b.u[t] ** 2})
    m.cost = pyo.Objective(expr=b.spent[b.final_time])
    return m


def steepest_descent(**how):
    """A quarter of a cycloid in the time pi / 2."""
    m = pyo.ConcreteModel(name="brachistochrone")
    m.p = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 10), initial_guess=1), **how)
    b.x = rcp.State(initial=0, final=pi / 2 - 1, initial_guess=lambda t: 0.5 * t)
    b.y, b.v = rcp.State(initial=0, final=1, initial_guess=lambda t: t), rcp.State(initial=0, initial_guess=lambda t: t)
    b.angle = rcp.Control(bounds=(0, 3), initial_guess=0.7)

    @b.ode
    def slide(b, t):
        sine, cosine = pyo.sin(b.angle[t]), pyo.cos(b.angle[t])
        return {b.x: b.v[t] * sine, b.y: b.v[t] * cosine, b.v: cosine}

    m.cost = pyo.Objective(expr=b.duration)
    return m


def hanging_chain(**how):
    """The chain of COPS 3: the least potential energy at a given length."""
    m = pyo.ConcreteModel(name="hanging chain")
    m.p = b = rcp.PhaseBlock(duration=1.0, **how)
    b.x, b.u = rcp.State(initial=1, final=3, initial_guess=lambda t: 1 + 2 * t), rcp.Control(initial_guess=2.0)
    b.ode(lambda b, t: {b.x: b.u[t]})
    m.length = pyo.Constraint(expr=b.integral(lambda b, t: (1 + b.u[t] ** 2) ** 0.5) == 4)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] * (1 + b.u[t] ** 2) ** 0.5))
    return m


def below_a_ceiling(**how):
    """Bryson & Denham: least effort below a bound of the position; 4."""
    m = pyo.ConcreteModel(name="below a ceiling")
    m.p = b = rcp.PhaseBlock(duration=1.0, **how)
    b.x, b.v = rcp.State(initial=0, final=0, bounds=(None, 1 / 9)), rcp.State(initial=1, final=-1)
    b.u = rcp.Control()
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: 0.5 * b.u[t] ** 2))
    return m


def van_der_pol(**how):
    """With a floor for the speed of the oscillation."""
    m = pyo.ConcreteModel(name="van der Pol")
    m.p = b = rcp.PhaseBlock(duration=5.0, **how)
    b.x, b.y, b.u = rcp.State(initial=1), rcp.State(initial=0, bounds=(-0.4, None)), rcp.Control(bounds=(-2, 2))
    b.ode(lambda b, t: {b.x: b.y[t], b.y: (1 - b.x[t] ** 2) * b.y[t] - b.x[t] + b.u[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.y[t] ** 2 + b.u[t] ** 2))
    return m


def rayleigh(**how):
    """Tun & Dillon's oscillator."""
    m = pyo.ConcreteModel(name="Rayleigh")
    m.p = b = rcp.PhaseBlock(duration=2.5, **how)
    b.x, b.y = rcp.State(initial=-5, initial_guess=-5), rcp.State(initial=-5, initial_guess=-5)
    b.u = rcp.Control()
    b.ode(lambda b, t: {b.x: b.y[t], b.y: -b.x[t] + (1.4 - 0.14 * b.y[t] ** 2) * b.y[t] + 4 * b.u[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2))
    return m


def moving_limit(**how):
    """Jacobson & Lele: a limit of the speed that is a parabola of time."""
    m = pyo.ConcreteModel(name="moving limit")
    m.p = b = rcp.PhaseBlock(duration=1, **how)
    b.x, b.y, b.u = rcp.State(initial=0), rcp.State(initial=-1), rcp.Control(bounds=(-20, 20))
    b.ode(lambda b, t: {b.x: b.y[t], b.y: -b.y[t] + b.u[t]})
    b.constraint(lambda b, t: b.y[t] <= 8 * (t - 0.5) ** 2 - 0.5)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.y[t] ** 2 + 0.005 * b.u[t] ** 2))
    return m


def mixed_limit(**how):
    """Effort and position share one limit, which holds for a part of the time."""
    m = pyo.ConcreteModel(name="mixed limit")
    m.p = b = rcp.PhaseBlock(duration=2.0, **how)
    b.x, b.v = rcp.State(initial=0, final=1), rcp.State(initial=0, final=0)
    b.u = rcp.Control()
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - 0.2 * b.v[t] ** 2})
    b.constraint(lambda b, t: b.u[t] + b.x[t] <= 1.2)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m


def stirred_tank(**how):
    """Luus' reactor."""
    m = pyo.ConcreteModel(name="stirred tank")
    m.p = b = rcp.PhaseBlock(duration=0.78, **how)
    b.x, b.y = rcp.State(initial=0.09), rcp.State(initial=0.09)
    b.u = rcp.Control(bounds=(0, 5), initial_guess=1)

    @b.ode
    def reaction(b, t):
        rate = (b.y[t] + 0.5) * pyo.exp(25 * b.x[t] / (b.x[t] + 2))
        return {b.x: -(2 + b.u[t]) * (b.x[t] + 0.25) + rate, b.y: 0.5 - b.y[t] - rate}

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.y[t] ** 2 + 0.1 * b.u[t] ** 2))
    return m


def batch_reactor(**how):
    """Ray's reactor, its product maximised; the control ends at its bound."""
    m = pyo.ConcreteModel(name="batch reactor")
    m.p = b = rcp.PhaseBlock(duration=1.0, **how)
    b.x, b.y = rcp.State(initial=1), rcp.State(initial=0)
    b.u = rcp.Control(bounds=(0, 5))
    b.ode(lambda b, t: {b.x: -(b.u[t] + b.u[t] ** 2 / 2) * b.x[t], b.y: b.u[t] * b.x[t]})
    m.product = pyo.Objective(expr=b.y[b.final_time], sense=pyo.maximize)
    return m


def orbit_raising(**how):
    """The largest circular orbit: the mass is a given function of time."""
    m = pyo.ConcreteModel(name="orbit raising")
    m.p = b = rcp.PhaseBlock(duration=3.3207, **how)
    b.r, b.u = rcp.State(initial=1, bounds=(0.5, 3), initial_guess=1.2), rcp.State(initial=0, final=0)
    b.v = rcp.State(initial=1, initial_guess=0.9)
    b.direction = rcp.Control(bounds=(-pi, 2 * pi), initial_guess=1)

    @b.ode
    def orbit(b, t):
        thrust = 0.1405 / (1 - 0.0749 * t)
        outward = b.v[t] ** 2 / b.r[t] - 1 / b.r[t] ** 2 + thrust * pyo.sin(b.direction[t])
        return {b.r: b.u[t], b.u: outward, b.v: -b.u[t] * b.v[t] / b.r[t] + thrust * pyo.cos(b.direction[t])}

    end = b.final_time
    m.circle = pyo.Constraint(expr=b.v[end] ** 2 * b.r[end] == 1)
    m.radius = pyo.Objective(expr=b.r[end], sense=pyo.maximize)
    return m


def ship(**how):
    """Zermelo's ship in a current that grows with the distance from the bank."""
    m = pyo.ConcreteModel(name="ship in a current")
    m.p = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 20), initial_guess=5), **how)
    b.x, b.y = rcp.State(initial=3.65866, final=0), rcp.State(initial=-1.86370, final=0)
    b.heading = rcp.Control(bounds=(0, 2 * pi), initial_guess=3)
    b.initialize_straight_lines()
    b.ode(lambda b, t: {b.x: pyo.cos(b.heading[t]) - b.y[t], b.y: pyo.sin(b.heading[t])})
    m.cost = pyo.Objective(expr=b.duration)
    return m


def epidemic(**how):
    """Two strains of tuberculosis: six states in persons, two efforts that end at their bounds."""
    people, start = 30000, {"S": 76, "T": 1, "L1": 36, "L2": 2, "I1": 4, "I2": 1}
    m = pyo.ConcreteModel(name="tuberculosis")
    m.p = b = rcp.PhaseBlock(duration=5, **how)
    for name, parts in start.items():
        first = parts * people / 120
        b.declare(name, rcp.State(initial=first, bounds=(0, people), initial_guess=first))
    b.find, b.hold = rcp.Control(bounds=(0.05, 0.95)), rcp.Control(bounds=(0.05, 0.95))

    @b.ode
    def spread(b, t):
        s, treated, l1, l2, i1, i2 = (getattr(b, name)[t] for name in start)
        find, lost = 2 * b.find[t], 1 - b.hold[t]
        typical, resistant, leaving = 13 * i1 / people, 0.029 * i2 / people, 0.0143
        return {
            b.S: leaving * people - (typical + resistant + leaving) * s,
            b.T: find * l1 + (1 - 0.5 * lost) * i1 - (leaving + typical + resistant) * treated,
            b.L1: typical * (s + treated) + 0.4 * lost * i1 - (leaving + 0.5 + find + resistant) * l1,
            b.L2: 0.1 * lost * i1 - (leaving + 1) * l2 + resistant * (s + l1 + treated),
            b.I1: 0.5 * l1 - (leaving + 1) * i1,
            b.I2: l2 - leaving * i2,
        }

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.L2[t] + b.I2[t] + 25 * b.find[t] ** 2 + 250 * b.hold[t] ** 2))
    return m


def cart_pole(**how):
    """Kelly's swing-up."""
    m = pyo.ConcreteModel(name="cart-pole")
    m.p = b = rcp.PhaseBlock(duration=2, **how)
    b.q = rcp.State(index=2, initial=0, final=[1, pi], bounds=([-2, -2 * pi], [2, 2 * pi]))
    b.rate = rcp.State(index=2, initial=0, final=0)
    b.u = rcp.Control(bounds=(-20, 20))
    b.initialize_straight_lines()

    @b.ode
    def swing(b, t):
        angle, (_, turn), u = b.q[1, t], b.rate[t], b.u[t]
        sine, cosine = pyo.sin(angle), pyo.cos(angle)
        inertia = 1 + 0.3 * (1 - cosine**2)
        cart = (0.5 * 0.3 * sine * turn**2 + u + 0.3 * 9.81 * cosine * sine) / inertia
        pole = -(0.5 * 0.3 * cosine * sine * turn**2 + u * cosine + 1.3 * 9.81 * sine) / (0.5 * inertia)
        return {b.q: b.rate[t], b.rate: [cart, pole]}

    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m
