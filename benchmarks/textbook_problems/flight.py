"""What flies, sails or turns in space."""

from __future__ import annotations

from math import cos, pi, radians, sin

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp


def largest_range(mesh=None, elements=None):
    """How far a constant thrust carries a mass under gravity: Bryson & Ho 1975; the manual of PROPT."""
    m = pyo.ConcreteModel(name="largest range")
    m.flight = b = rcp.PhaseBlock(duration=2, mesh=mesh, elements=elements)
    b.x, b.y, b.v = rcp.State(initial=0), rcp.State(initial=0, final=0.1), rcp.State(initial=0)
    b.angle = rcp.Control(bounds=(-pi, pi))

    @b.ode
    def flight(b, t):
        sine, cosine = pyo.sin(b.angle[t]), pyo.cos(b.angle[t])
        return {b.x: b.v[t] * cosine, b.y: b.v[t] * sine, b.v: 0.5 - sine}

    m.range = pyo.Objective(expr=b.x[b.final_time], sense=pyo.maximize)
    return m


def rigid_body(mesh=None, elements=None):
    """Turn an asymmetric body by 150 degrees in the shortest time: Betts 2010; the manual of PSOPT, also the guess."""
    m = pyo.ConcreteModel(name="reorientation of a rigid body")
    m.turn = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(10, 100), initial_guess=40), mesh=mesh, elements=elements)
    inertia = (5621.0, 4547.0, 2364.0)
    b.q = rcp.State(index=3, initial=0, final=[sin(radians(75)), 0, 0], bounds=(-1.1, 1.1))
    b.scalar = rcp.Algebraic(bounds=(-1.1, 1.1), initial_guess=lambda s: 1 + (cos(radians(75)) - 1) * s)
    b.w = rcp.State(index=3, initial=0, final=0)
    b.u = rcp.Control(index=3, bounds=(-50, 50), initial_guess=50)
    b.initialize_straight_lines()

    @b.ode
    def body(b, t):
        (q1, q2, q3), q4, (w1, w2, w3), (u1, u2, u3) = b.q[t], b.scalar[t], b.w[t], b.u[t]
        turning = [w1 * q4 - w2 * q3 + w3 * q2, w1 * q3 + w2 * q4 - w3 * q1, w2 * q1 - w1 * q2 + w3 * q4]
        i1, i2, i3 = inertia
        rates = [(u1 - (i3 - i2) * w2 * w3) / i1, (u2 - (i1 - i3) * w1 * w3) / i2, (u3 - (i2 - i1) * w1 * w2) / i3]
        return {b.q: [rate / 2 for rate in turning], b.w: rates}

    b.residual(unit_quaternion)
    m.time_taken = pyo.Objective(expr=b.duration)
    return m


def unit_quaternion(b, t):
    """What determines the scalar part."""
    return b.q[t] @ b.q[t] + b.scalar[t] ** 2 == 1


def missile(mesh=None, elements=None):
    """A bunt: arrive from above in the shortest time, metres and newtons: Subchan & Zbikowski; the manual of PSOPT."""
    m = pyo.ConcreteModel(name="terminal bunt of a missile")
    m.flight = b = rcp.PhaseBlock(
        duration=rcp.Duration(bounds=(20, 50), initial_guess=45), mesh=mesh, elements=elements
    )
    b.path = rcp.State(initial=0, final=-pi / 2)
    b.v = rcp.State(initial=272, final=310, bounds=(200, 310))
    b.x = rcp.State(initial=0, final=10000)
    b.h = rcp.State(initial=30, final=0, bounds=(0, 3000), initial_guess=500)
    b.attack = rcp.Control(bounds=(-0.3, 0.3))
    b.thrust = rcp.Control(bounds=(1000, 6000), initial_guess=4000)
    b.initialize_straight_lines()
    mass, gravity = 1005.0, 9.81

    def forces(b, t):
        attack = b.attack[t]
        density = 3.312e-9 * b.h[t] ** 2 - 1.142e-4 * b.h[t] + 1.224
        pressure = 0.5 * density * b.v[t] ** 2 * 0.3376
        drag, lift = pressure * (-1.9431 * attack**2 - 0.1499 * attack + 0.2359), pressure * 21.9 * attack
        along = (b.thrust[t] - drag) / mass
        upward = (along * pyo.sin(attack) + lift / mass * pyo.cos(attack)) / gravity
        return along * pyo.cos(attack) - lift / mass * pyo.sin(attack), upward

    @b.ode
    def flight(b, t):
        along, load = forces(b, t)
        sine, cosine, v = pyo.sin(b.path[t]), pyo.cos(b.path[t]), b.v[t]
        return {b.path: gravity * (load - cosine) / v, b.v: along - gravity * sine, b.x: v * cosine, b.h: v * sine}

    @b.constraint
    def load(b, t):
        return (-4, forces(b, t)[1], 4)

    m.time_taken = pyo.Objective(expr=b.duration)
    return m


def obstacle_avoidance(mesh=None, elements=None):
    """The least energy around two discs: the manual of PSOPT."""
    m = pyo.ConcreteModel(name="obstacle avoidance")
    m.run = b = rcp.PhaseBlock(duration=1, mesh=mesh, elements=elements)
    b.r = rcp.State(index=2, initial=0, final=[1.2, 1.6])
    b.heading = rcp.Control(bounds=(-10, 10), initial_guess=1)
    b.initialize_straight_lines()
    b.ode(lambda b, t: {b.r: [2.138 * pyo.cos(b.heading[t]), 2.138 * pyo.sin(b.heading[t])]})

    @b.constraint
    def apart(b, t):
        x, y = b.r[t]
        return [(x - 0.4) ** 2 + (y - 0.5) ** 2 >= 0.1, (x - 0.8) ** 2 + (y - 1.5) ** 2 >= 0.1]

    def speed(b, t):
        return 2.138**2 * (pyo.cos(b.heading[t]) ** 2 + pyo.sin(b.heading[t]) ** 2)

    m.energy = pyo.Objective(expr=b.integral(speed))
    return m


def two_link_robot(mesh=None, elements=None):
    """From one pose to another in the shortest time: Luus 2000; the manual of PSOPT."""
    m = pyo.ConcreteModel(name="two-link robot")
    m.move = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(1, 10), initial_guess=3), mesh=mesh, elements=elements)
    b.x = rcp.State(index=4, initial=[0, 0, 0.5, 0], final=[0, 0, 0.5, 0.522])
    b.u = rcp.Control(index=2, bounds=(-1, 1))
    b.initialize_straight_lines()

    @b.ode
    def robot(b, t):
        (w1, w2, bend, _), (u1, u2) = b.x[t], b.u[t]
        s, c = pyo.sin(bend), pyo.cos(bend)
        d = 31 / 36 + 9 / 4 * s**2
        first = (s * (9 / 4 * c * w1**2 + 2 * w2**2) + 4 / 3 * (u1 - u2) - 3 / 2 * c * u2) / d
        second = -(s * (7 / 2 * w1**2 + 9 / 4 * c * w2**2) - 7 / 3 * u2 + 3 / 2 * c * (u1 - u2)) / d
        return {b.x: [first, second, w2 - w1, w1]}

    m.time_taken = pyo.Objective(expr=b.duration)
    return m
