"""Problems of optimal control with several local optima, from initial guesses that lead to the worse ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, pi, radians, sin
from typing import Any

import pyomo.environ as pyo
from textbook_problems.plants import catalyst_rates

import pyrobocop_pyomo as rcp


@dataclass(frozen=True)
class SeveralOptima:
    """A problem with several local optima.

    Attributes
    ----------
    name : str
    best : float
        The best value of the objective that is known, on the mesh of `build`.
    build : callable
        ``build()`` makes the model.
    published : bool
        Whether a source gives the value; otherwise many random starts did.
    """

    name: str
    best: float
    build: Callable[[], Any]
    published: bool = False


def f8_aircraft(elements=40):
    """Level flight after a gust in the shortest time: Garrard & Jordan 1977; Kaya & Noakes 2003; mintOC: 3.78086."""
    m = pyo.ConcreteModel(name="F-8 aircraft")
    m.flight = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.5, 20), initial_guess=5), elements=elements)
    b.attack = rcp.State(initial=0.4655, final=0)
    b.pitch = rcp.State(initial=0, final=0)
    b.rate = rcp.State(initial=0, final=0)
    b.tail = rcp.Control(bounds=(-0.05236, 0.05236))

    @b.ode
    def motion(b, t):
        x, y, z, u = b.attack[t], b.pitch[t], b.rate[t], b.tail[t]
        lift = -0.877 * x + z - 0.088 * x * z + 0.47 * x**2 - 0.019 * y**2 - x**2 * z + 3.846 * x**3
        lift += -0.215 * u + 0.28 * x**2 * u + 0.47 * x * u**2 + 0.63 * u**3
        turn = -4.208 * x - 0.396 * z - 0.47 * x**2 - 3.564 * x**3
        turn += -20.967 * u + 6.265 * x**2 * u + 46 * x * u**2 + 61.4 * u**3
        return {b.attack: lift, b.pitch: z, b.rate: turn}

    m.time_taken = pyo.Objective(expr=b.duration)
    return m


def swimmer(elements=40, drag=(1.0, 2.0)):
    """Three rigid links in a viscous fluid, two joints, the farthest stroke: Purcell 1977; resistive forces."""
    m = pyo.ConcreteModel(name="swimmer")
    m.stroke = b = rcp.PhaseBlock(duration=8, elements=elements)
    b.x, b.y, b.angle = rcp.State(initial=0), rcp.State(initial=0), rcp.State(initial=0)
    b.joint = rcp.State(index=2, initial=0, final=0, bounds=(-pi / 2, pi / 2))
    b.rate = rcp.Control(index=2, bounds=(-1, 1))
    b.vx, b.vy, b.turn = rcp.Algebraic(), rcp.Algebraic(), rcp.Algebraic()

    @b.ode
    def motion(b, t):
        return {b.x: b.vx[t], b.y: b.vy[t], b.angle: b.turn[t], b.joint: [b.rate[t][0], b.rate[t][1]]}

    def forces(b, t):
        """Force and torque of the fluid; the middle link is at the state, from -1/2 to 1/2."""
        along, across = drag
        heading, turn = b.angle[t], b.turn[t]
        (left, right), (dleft, dright) = b.joint[t], b.rate[t]
        total = [0.0, 0.0, 0.0]
        ends = ((-0.5, -1, left, dleft), (0.0, 0, 0.0, 0.0), (0.5, 1, right, dright))
        for root, side, bend, dbend in ends:
            phi, dphi = heading + bend, turn + dbend
            c, s = pyo.cos(phi), pyo.sin(phi)
            rx, ry = root * pyo.cos(heading), root * pyo.sin(heading)
            mx, my = rx + side * 0.5 * c, ry + side * 0.5 * s
            vx = b.vx[t] - turn * ry - side * 0.5 * s * dphi
            vy = b.vy[t] + turn * rx + side * 0.5 * c * dphi
            tangential, normal = along * (vx * c + vy * s), across * (-vx * s + vy * c)
            fx, fy = tangential * c - normal * s, tangential * s + normal * c
            total[0] += fx
            total[1] += fy
            total[2] += mx * fy - my * fx + across * dphi / 12
        return total

    b.residual(lambda b, t: [one == 0 for one in forces(b, t)])
    m.farthest = pyo.Objective(expr=b.x[b.final_time], sense=pyo.maximize)
    return m


def turning_body(inertia, degrees, torque, times, guess, elements=30):
    """A rest-to-rest turn about the first axis in the shortest time."""

    def build():
        m = pyo.ConcreteModel(name="reorientation")
        m.turn = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=times, initial_guess=guess), elements=elements)
        half = radians(degrees / 2)
        b.q = rcp.State(index=3, initial=0, final=[sin(half), 0, 0], bounds=(-1.1, 1.1))
        b.scalar = rcp.Algebraic(bounds=(-1.1, 1.1), initial_guess=lambda s: 1 + (cos(half) - 1) * s)
        b.w = rcp.State(index=3, initial=0, final=0)
        b.u = rcp.Control(index=3, bounds=(-torque, torque))
        b.initialize_straight_lines()
        i1, i2, i3 = inertia

        @b.ode
        def body(b, t):
            (q1, q2, q3), q4, (w1, w2, w3), (u1, u2, u3) = b.q[t], b.scalar[t], b.w[t], b.u[t]
            turning = [w1 * q4 - w2 * q3 + w3 * q2, w1 * q3 + w2 * q4 - w3 * q1, w2 * q1 - w1 * q2 + w3 * q4]
            rates = [(u1 - (i3 - i2) * w2 * w3) / i1, (u2 - (i1 - i3) * w1 * w3) / i2, (u3 - (i2 - i1) * w1 * w2) / i3]
            return {b.q: [rate / 2 for rate in turning], b.w: rates}

        b.residual(lambda b, t: b.q[t] @ b.q[t] + b.scalar[t] ** 2 == 1)
        m.time_taken = pyo.Objective(expr=b.duration)
        return m

    return build


def cart_pole(elements=40, track=0.8, force=12.0, duration=3.0):
    """Swing a pole up on a short track with a weak motor and the least effort."""
    m = pyo.ConcreteModel(name="cart-pole on a short track")
    m.p = b = rcp.PhaseBlock(duration=duration, elements=elements)
    b.x = rcp.State(initial=0, final=0, bounds=(-track, track))
    b.angle = rcp.State(initial=0, final=pi)
    b.v, b.w = rcp.State(initial=0, final=0), rcp.State(initial=0, final=0)
    b.u = rcp.Control(bounds=(-force, force))
    b.initialize_straight_lines()

    @b.ode
    def swing(b, t):
        sine, cosine = pyo.sin(b.angle[t]), pyo.cos(b.angle[t])
        inertia = 1 + 0.3 * sine**2
        cart = (0.15 * sine * b.w[t] ** 2 + b.u[t] + 0.3 * 9.81 * cosine * sine) / inertia
        pole = -(0.15 * cosine * sine * b.w[t] ** 2 + b.u[t] * cosine + 1.3 * 9.81 * sine) / (0.5 * inertia)
        return {b.x: b.v[t], b.angle: b.w[t], b.v: cart, b.w: pole}

    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m


def acrobot(elements=40, duration=4.0, torque=6.0):
    """Two equal links, a motor in the joint between them: up with the least effort: Spong 1995."""
    m = pyo.ConcreteModel(name="acrobot")
    m.p = b = rcp.PhaseBlock(duration=duration, elements=elements)
    b.q = rcp.State(index=2, initial=0, final=[pi, 0])
    b.w = rcp.State(index=2, initial=0, final=0)
    b.u = rcp.Control(bounds=(-torque, torque))
    b.initialize_straight_lines()
    g = 9.81

    @b.ode
    def swing(b, t):
        (a, e), (da, de), u = b.q[t], b.w[t], b.u[t]
        c, s = pyo.cos(e), pyo.sin(e)
        # Point masses of 1 kg in the middle of links of 1 m, inertias of rods.
        m11, m12, m22 = 5 / 3 + c, 1 / 3 + 0.5 * c, 1 / 3
        h1 = -s * da * de - 0.5 * s * de**2 + g * (1.5 * pyo.sin(a) + 0.5 * pyo.sin(a + e))
        h2 = 0.5 * s * da**2 + 0.5 * g * pyo.sin(a + e)
        det = m11 * m22 - m12**2
        first = (-m22 * h1 - m12 * (u - h2)) / det
        second = (m11 * (u - h2) + m12 * h1) / det
        return {b.q: [da, de], b.w: [first, second]}

    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m


def pendulum(elements=40, torque=3.0, duration=4.0):
    """Swing a pendulum up with a motor that cannot hold it level."""
    m = pyo.ConcreteModel(name="pendulum")
    m.p = b = rcp.PhaseBlock(duration=duration, elements=elements)
    b.angle, b.w = rcp.State(initial=0, final=pi), rcp.State(initial=0, final=0)
    b.u = rcp.Control(bounds=(-torque, torque))
    b.initialize_straight_lines()
    b.ode(lambda b, t: {b.angle: b.w[t], b.w: b.u[t] - 9.81 * pyo.sin(b.angle[t])})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m


def orbit_transfer(elements=40, duration=16.0, radius=1.5):
    """Between circular orbits with the least effort, revolutions free: a small thrust over a long time."""
    m = pyo.ConcreteModel(name="orbit transfer")
    m.p = b = rcp.PhaseBlock(duration=duration, elements=elements)
    b.r = rcp.State(initial=1, final=radius, bounds=(0.5, 4))
    b.theta = rcp.State(initial=0)
    b.vr = rcp.State(initial=0, final=0)
    b.vt = rcp.State(initial=1, final=radius**-0.5)
    b.u = rcp.Control(index=2, bounds=(-0.2, 0.2))
    b.initialize_straight_lines()

    @b.ode
    def flight(b, t):
        r, vr, vt, (ur, ut) = b.r[t], b.vr[t], b.vt[t], b.u[t]
        return {b.r: vr, b.theta: vt / r, b.vr: vt**2 / r - 1 / r**2 + ur, b.vt: -vr * vt / r + ut}

    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] @ b.u[t]))
    return m


def rendezvous(elements=40, duration=14.0):
    """To a place on a circular orbit: how many revolutions is free, by sine and cosine of the angle."""
    m = pyo.ConcreteModel(name="rendezvous")
    m.p = b = rcp.PhaseBlock(duration=duration, elements=elements)
    b.r = rcp.State(index=2, initial=[1, 0], final=[0, -1.5])
    b.v = rcp.State(index=2, initial=[0, 1], final=[1.5**-0.5, 0])
    b.u = rcp.Control(index=2, bounds=(-1, 1))
    b.initialize_straight_lines()

    @b.ode
    def flight(b, t):
        (x, y), (ux, uy) = b.r[t], b.u[t]
        cube = (x**2 + y**2 + 1e-3) ** 1.5
        return {b.r: [b.v[t][0], b.v[t][1]], b.v: [ux - x / cube, uy - y / cube]}

    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] @ b.u[t]))
    return m


def zermelo(elements=40):
    """Across a sea with four vortices in the shortest time."""
    m = pyo.ConcreteModel(name="vortices")
    m.p = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(1, 50), initial_guess=8), elements=elements)
    b.r = rcp.State(index=2, initial=[0, 0], final=[8, 0.5])
    b.u = rcp.Control(index=2, bounds=(-1, 1), initial_guess=[1, 0])
    b.initialize_straight_lines()
    vortices = ((2, 0.8, 1.6), (4, -0.9, -1.5), (5, 1.2, 1.4), (6.5, -0.4, 1.7))

    @b.ode
    def current(b, t):
        (x, y), (ux, uy) = b.r[t], b.u[t]
        vx, vy = ux, uy
        for px, py, strength in vortices:
            size = strength * pyo.exp(-((x - px) ** 2 + (y - py) ** 2))
            vx, vy = vx - size * (y - py), vy + size * (x - px)
        return {b.r: [vx, vy]}

    b.constraint(lambda b, t: b.u[t] @ b.u[t] <= 1)
    m.time_taken = pyo.Objective(expr=b.duration)
    return m


def mountain_car(elements=60, duration=8.0):
    """Out of a valley with a weak motor and the least effort: Moore 1990."""
    m = pyo.ConcreteModel(name="mountain car")
    m.p = b = rcp.PhaseBlock(duration=duration, elements=elements)
    b.x = rcp.State(initial=-0.5, final=0.6, bounds=(-1.4, 0.6))
    b.v = rcp.State(initial=0, bounds=(-3, 3))
    b.u = rcp.Control(bounds=(-1, 1))
    b.initialize_straight_lines()
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - 2.5 * pyo.cos(3 * b.x[t])})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m


def wrong_side(elements=40):
    """Round a hill that is not in the middle, guessed round its far side."""
    m = pyo.ConcreteModel(name="hill, guessed on its far side")
    m.path = b = rcp.PhaseBlock(duration=1, elements=elements)
    b.r = rcp.State(index=2, initial=[-2, 0], final=[2, 0], initial_guess=lambda s: [-2 + 4 * s, -2 * sin(pi * s)])
    b.v = rcp.Control(index=2, initial_guess=[4, 0])
    b.ode(lambda b, t: {b.r: b.v[t]})

    def cost(b, t):
        (x, y), (vx, vy) = b.r[t], b.v[t]
        return vx**2 + vy**2 + 80 * pyo.exp(-(x**2) - (y + 0.6) ** 2)

    m.cost = pyo.Objective(expr=b.integral(cost))
    return m


def two_wells(elements=40):
    """A particle in the shallow one of two wells; the deep one is worth the way."""
    m = pyo.ConcreteModel(name="two wells")
    m.p = b = rcp.PhaseBlock(duration=10, elements=elements)
    b.x, b.v = rcp.State(initial=-1), rcp.State(initial=0)
    b.u = rcp.Control()
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.x[t] ** 2 - 1) ** 2 - 0.5 * b.x[t] + 0.5 * b.u[t] ** 2))
    return m


def stirred_tank(elements=20):
    """Two temperatures: 0.13309 and 0.24442: Luus & Galli 1991, guessed at the worse one."""
    m = pyo.ConcreteModel(name="stirred tank")
    m.p = b = rcp.PhaseBlock(duration=0.78, elements=elements)
    b.x, b.y = rcp.State(initial=0.09, initial_guess=0.4), rcp.State(initial=0.09, initial_guess=-0.4)
    b.u = rcp.Control(bounds=(0, 5), initial_guess=0.2)

    @b.ode
    def tank(b, t):
        x, y, u = b.x[t], b.y[t], b.u[t]
        reaction = (y + 0.5) * pyo.exp(25 * x / (x + 2))
        return {b.x: -(2 + u) * (x + 0.25) + reaction, b.y: 0.5 - y - reaction}

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.y[t] ** 2 + 0.1 * b.u[t] ** 2))
    return m


def bifunctional_catalyst(elements=40):
    """A blend along a reactor, with hundreds of local optima: Luus, Dittrich & Keil 1992: 10.0942 (thousandths)."""
    m = pyo.ConcreteModel(name="bifunctional catalyst")
    m.p = b = rcp.PhaseBlock(duration=2000, elements=elements)
    b.x = rcp.State(index=7, initial=[1, 0, 0, 0, 0, 0, 0])
    b.u = rcp.Control(bounds=(0.6, 0.9), initial_guess=0.75)

    b.ode(lambda b, t: {b.x: catalyst_rates(b.x[t], b.u[t])})
    m.yield_ = pyo.Objective(expr=1000 * b.x[6, b.final_time], sense=pyo.maximize)
    return m


def dubins(elements=40):
    """A car that only goes forward and turns on circles, the shortest path between poses: Dubins 1957."""
    m = pyo.ConcreteModel(name="Dubins car")
    m.p = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.5, 30), initial_guess=6), elements=elements)
    b.x, b.y = rcp.State(initial=0, final=1.5), rcp.State(initial=0, final=-0.5)
    b.angle = rcp.State(initial=0)
    b.u = rcp.Control(bounds=(-1, 1))
    b.initialize_straight_lines()
    b.ode(lambda b, t: {b.x: pyo.cos(b.angle[t]), b.y: pyo.sin(b.angle[t]), b.angle: b.u[t]})
    end = b.final_time
    m.cosine = pyo.Constraint(expr=pyo.cos(b.angle[end]) <= -0.999999)
    m.time_taken = pyo.Objective(expr=b.duration)
    return m


def two_passes(elements=40):
    """Over a ridge with a low pass far off and a high one near: the least climbing and going."""
    m = pyo.ConcreteModel(name="two passes")
    m.path = b = rcp.PhaseBlock(duration=1, elements=elements)
    b.r = rcp.State(index=2, initial=[-2, 0], final=[2, 0])
    b.v = rcp.Control(index=2, initial_guess=[4, 0])
    b.initialize_straight_lines()
    b.ode(lambda b, t: {b.r: b.v[t]})

    def cost(b, t):
        (x, y), (vx, vy) = b.r[t], b.v[t]
        passes = 1 - 0.4 * pyo.exp(-2 * (y - 0.4) ** 2) - 0.95 * pyo.exp(-2 * (y + 1.6) ** 2)
        return vx**2 + vy**2 + 120 * pyo.exp(-3 * x**2) * passes

    m.cost = pyo.Objective(expr=b.integral(cost))
    return m


def round_disc(elements=40, offset=0.0):
    """Round a disc that stands in the way, the guess straight through its middle."""
    m = pyo.ConcreteModel(name="disc in the middle")
    m.path = b = rcp.PhaseBlock(duration=1, elements=elements)
    b.r = rcp.State(index=2, initial=[-2, 0], final=[2, 0])
    b.v = rcp.Control(index=2, initial_guess=[4, 0])
    b.initialize_straight_lines()
    b.ode(lambda b, t: {b.r: b.v[t]})
    b.constraint(lambda b, t: b.r[t][0] ** 2 + (b.r[t][1] - offset) ** 2 >= 1)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.v[t] @ b.v[t]))
    return m


def fast_round_disc(elements=40):
    """The same in the shortest time, with a bounded acceleration."""
    m = pyo.ConcreteModel(name="disc in the middle, shortest time")
    m.path = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.5, 20), initial_guess=4), elements=elements)
    b.r = rcp.State(index=2, initial=[-2, 0], final=[2, 0])
    b.v = rcp.State(index=2, initial=0, final=0)
    b.a = rcp.Control(index=2, bounds=(-1, 1))
    b.initialize_straight_lines()
    b.ode(lambda b, t: {b.r: b.v[t], b.v: b.a[t]})
    b.constraint(lambda b, t: b.r[t][0] ** 2 + b.r[t][1] ** 2 >= 1)
    m.time_taken = pyo.Objective(expr=b.duration)
    return m


BETTS = (5621.0, 4547.0, 2364.0)

PROBLEMS = (
    SeveralOptima("f8_aircraft", 3.78086, f8_aircraft, published=True),
    SeveralOptima("swimmer", 0.263105, swimmer),
    SeveralOptima("rigid_body_betts", 28.6304, turning_body(BETTS, 150, 50, (10, 100), 40), published=True),
    SeveralOptima("sphere_180", 3.26778, turning_body((1, 1, 1), 180, 1, (0.5, 20), 5)),
    SeveralOptima("rod_like_body", 2.80047, turning_body((1, 1, 0.2), 150, 1, (0.5, 20), 5)),
    SeveralOptima("flat_body", 3.70206, turning_body((2, 1, 1), 180, 1, (0.5, 20), 5)),
    SeveralOptima("cart_pole", 34.9025, cart_pole),
    SeveralOptima("acrobot", 23.3461, acrobot),
    SeveralOptima("pendulum", 29.4779, pendulum),
    SeveralOptima("orbit_transfer", 0.00213448, orbit_transfer),
    SeveralOptima("rendezvous", 0.114897, rendezvous),
    SeveralOptima("zermelo_vortices", 6.12455, zermelo),
    SeveralOptima("mountain_car", 0.904407, mountain_car),
    SeveralOptima("wrong_side", 25.1529, wrong_side),
    SeveralOptima("two_wells", -1.72725, two_wells),
    SeveralOptima("stirred_tank", 0.13309, stirred_tank, published=True),
    SeveralOptima("bifunctional_catalyst", 10.0942, bifunctional_catalyst, published=True),
    SeveralOptima("dubins", 6.15872, dubins),
    SeveralOptima("two_passes", 29.7987, two_passes),
    SeveralOptima("round_disc", 20.3518, round_disc),
    SeveralOptima("fast_round_disc", 4.0, fast_round_disc),
)
