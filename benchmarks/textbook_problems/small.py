"""Small problems with one difficulty each, and models of living things."""

from __future__ import annotations

from math import pi

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp


def hypersensitive(mesh=None, elements=None):
    """A long horizon with layers at both ends: Patterson & Rao, ACM TOMS 41 (2014), doi:10.1145/2558904."""
    m = pyo.ConcreteModel(name="hypersensitive problem")
    m.p = b = rcp.PhaseBlock(duration=10000, mesh=mesh, elements=elements)
    b.x = rcp.State(initial=1, final=1.5, initial_guess=1)
    b.u = rcp.Control()
    b.ode(lambda b, t: {b.x: -(b.x[t] ** 3) + b.u[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.x[t] ** 2 + b.u[t] ** 2) / 2))
    return m


def rayleigh(mesh=None, elements=None):
    """An electric oscillator: Tun & Dillon 1978; the manual of PROPT."""
    m = pyo.ConcreteModel(name="Rayleigh problem")
    m.p = b = rcp.PhaseBlock(duration=2.5, mesh=mesh, elements=elements)
    b.x = rcp.State(initial=-5, initial_guess=-5)
    b.y = rcp.State(initial=-5, initial_guess=-5)
    b.u = rcp.Control()
    b.ode(lambda b, t: {b.x: b.y[t], b.y: -b.x[t] + (1.4 - 0.14 * b.y[t] ** 2) * b.y[t] + 4 * b.u[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2))
    return m


def jacobson_lele(mesh=None, elements=None):
    """A moving limit of the speed: Jacobson & Lele, IEEE Trans. Automatic Control 14 (1969); the manual of PSOPT."""
    m = pyo.ConcreteModel(name="state-constrained problem")
    m.p = b = rcp.PhaseBlock(duration=1, mesh=mesh, elements=elements)
    b.x, b.y = rcp.State(initial=0), rcp.State(initial=-1)
    b.u = rcp.Control(bounds=(-20, 20))
    b.ode(lambda b, t: {b.x: b.y[t], b.y: -b.y[t] + b.u[t]})

    @b.constraint
    def limit(b, t):
        return b.y[t] <= 8 * (t - 0.5) ** 2 - 0.5

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.y[t] ** 2 + 0.005 * b.u[t] ** 2))
    return m


def fastest_stop(mesh=None, elements=None):
    """A double integrator to rest in the shortest time: two seconds and one switch: Bryson & Ho 1975, sec. 3.9."""
    m = pyo.ConcreteModel(name="double integrator in minimum time")
    m.p = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 10), initial_guess=1), mesh=mesh, elements=elements)
    b.x, b.v = rcp.State(initial=0, final=1), rcp.State(initial=0, final=0)
    b.u = rcp.Control(bounds=(-1, 1))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
    m.time_taken = pyo.Objective(expr=b.duration)
    return m


def singular_arc(mesh=None, elements=None):
    """The third state is the cost of a singular double integrator: Aly & Chan 1973."""
    m = pyo.ConcreteModel(name="singular problem of Aly and Chan")
    m.p = b = rcp.PhaseBlock(duration=5, mesh=mesh, elements=elements)
    b.x, b.y = rcp.State(initial=0), rcp.State(initial=1)
    b.u = rcp.Control(bounds=(-1, 1))
    b.ode(lambda b, t: {b.x: b.y[t], b.y: b.u[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.y[t] ** 2))
    return m


def tumour(mesh=None, elements=None):
    """The smallest tumour with a limited amount of an inhibitor: Ledzewicz & Schaettler 2007; Betts 2010, sec. 6.17."""
    m = pyo.ConcreteModel(name="anti-angiogenesis")
    m.p = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 5), initial_guess=1), mesh=mesh, elements=elements)
    largest = ((5.85 - 0.02) / 0.00873) ** 1.5
    b.volume = rcp.State(initial=largest / 2, bounds=(0.01, largest), initial_guess=largest / 2)
    b.vessels = rcp.State(initial=largest / 4, bounds=(0.01, largest), initial_guess=largest / 4)
    b.given = rcp.State(initial=0, bounds=(0, 15), initial_guess=7)
    b.dose = rcp.Control(bounds=(0, 75), initial_guess=37)

    @b.ode
    def growth(b, t):
        p, q, u = b.volume[t], b.vessels[t], b.dose[t]
        support = q * (5.85 - 0.02 - 0.00873 * p ** (2 / 3) - 0.15 * u)
        return {b.volume: -0.084 * p * pyo.log(p / q), b.vessels: support, b.given: u}

    m.size = pyo.Objective(expr=b.volume[b.final_time])
    return m


def fishing(mesh=None, elements=None):
    """Lotka-Volterra with a fleet that goes out in part, the relaxed problem: Sager 2005; mintOC.de."""
    m = pyo.ConcreteModel(name="fishing")
    m.p = b = rcp.PhaseBlock(duration=12, mesh=mesh, elements=elements)
    b.x, b.y = rcp.State(initial=0.5, initial_guess=1), rcp.State(initial=0.7, initial_guess=1)
    b.w = rcp.Control(bounds=(0, 1), initial_guess=0.5)

    @b.ode
    def sea(b, t):
        x, y, w = b.x[t], b.y[t], b.w[t]
        return {b.x: x - x * y - 0.4 * x * w, b.y: -y + x * y - 0.2 * y * w}

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.x[t] - 1) ** 2 + (b.y[t] - 1) ** 2))
    return m


def drug_displacement(mesh=None, elements=None):
    """One drug displaces another, its concentration not limited: Maurer & Wiegand, in minutes; the manual of PROPT."""
    m = pyo.ConcreteModel(name="drug displacement")
    m.p = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(1, 1000), initial_guess=200), mesh=mesh, elements=elements)
    b.x = rcp.State(initial=0.02, final=0.02)
    b.y = rcp.State(initial=0, final=2)
    b.u = rcp.Control(bounds=(0, 8), initial_guess=4)
    b.initialize_straight_lines()

    @b.ode
    def blood(b, t):
        x, y, u = b.x[t], b.y[t], b.u[t]
        g2 = 1 + 0.2 * (x + y)
        g3, g4 = g2**2 + 232 + 46.4 * y, g2**2 + 232 + 46.4 * x
        g1 = g2**2 / (g3 * g4 - 2152.96 * x * y)
        first = g1 * (g4 * (0.02 - x) + 46.4 * x * (u - 2 * y))
        return {b.x: first, b.y: g1 * (g3 * (u - 2 * y) + 46.4 * y * (0.02 - x))}

    m.time_taken = pyo.Objective(expr=b.duration)
    return m


def cart_pole(mesh=None, elements=None):
    """Swing a pole up with the least effort: Kelly, SIAM Review 59 (2017) 849, sec. 6, appendix E."""
    m = pyo.ConcreteModel(name="cart-pole swing-up")
    m.p = b = rcp.PhaseBlock(duration=2, mesh=mesh, elements=elements)
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
