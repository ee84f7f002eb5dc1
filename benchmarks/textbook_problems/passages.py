"""Flights through air and out of it, with limits."""

from __future__ import annotations

import importlib
from math import degrees, log, pi, radians, sqrt

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp


def heated_reentry(mesh=None, elements=None):
    """The largest cross-range with limited heating of the wing's leading edge: Betts 2010, sec. 6.1."""
    m = importlib.import_module("reentry").build(mesh, elements)
    b = m.entry

    @b.constraint
    def heating(b, t):
        attack = degrees(1) * b.attack[t]
        profile = 1.0672181 - 0.19213774e-1 * attack + 0.21286289e-3 * attack**2 - 0.10117249e-5 * attack**3
        density = 0.002378 * pyo.exp(-b.h[t] / 23800)
        return 17700 * pyo.sqrt(density) * (0.0001 * b.v[t]) ** 3.07 * profile <= 70

    return m


METRES = 0.3048 * np.arange(-15000, 36000, 1000)  # the U.S. Standard Atmosphere 1976, in steps of 1000 feet
WARMTH = 1 - 0.0065 * METRES / (1 + METRES / 6356766) / 288.15
AIR = rcp.Table(METRES, 1.225 * WARMTH**4.25588, name="density")


def cannonball(mesh=None, elements=None):
    """Size and angle for the farthest shot, the air as a table: Falck et al., J. Open Source Software 6 (2021) 2809."""
    m = pyo.ConcreteModel(name="cannonball")
    m.radius = pyo.Var(bounds=(0.01, 0.1), initialize=0.05)
    guesses = {  # first and last of distance, height, speed and angle
        "ascent": ((0, 100), (0, 100), (200, 150), (radians(25), 0)),
        "descent": ((100, 200), (100, 0), (150, 200), (0, radians(-45))),
    }
    for name, ends in guesses.items():
        up = name == "ascent"
        time = rcp.Duration(bounds=(10 if up else 0.5, 100), initial_guess=10)
        b = rcp.PhaseBlock(duration=time, mesh=mesh and mesh[name], elements=elements)
        m.add_component(name, b)
        r, h, v, angle = (lambda s, a=a, c=c: a + (c - a) * s for a, c in ends)
        b.r = rcp.State(initial=0 if up else None, initial_guess=r)
        b.h = rcp.State(initial=0 if up else None, final=None if up else 0, initial_guess=h)
        b.v = rcp.State(initial_guess=v)
        b.angle = rcp.State(final=0 if up else None, initial_guess=angle)

        @b.ode
        def flight(b, t):
            sine, cosine, v = pyo.sin(b.angle[t]), pyo.cos(b.angle[t]), b.v[t]
            drag = 0.5 * AIR(b.h[t]) * v**2 * 0.5 / (4 / 3 * 7870 * m.radius)  # area over mass
            return {b.r: v * cosine, b.h: v * sine, b.v: -drag - 9.80665 * sine, b.angle: -9.80665 / v * cosine}

    m.apex = rcp.Link(m.ascent, m.descent)
    mass = 4 / 3 * 7870 * pi * m.radius**3
    m.energy = pyo.Constraint(expr=mass * m.ascent.v[m.ascent.initial_time] ** 2 / 2 <= 400000)
    m.range = pyo.Objective(expr=m.descent.r[m.descent.final_time], sense=pyo.maximize)
    return m


def two_burns(mesh=None, elements=None):
    """Burn, coast and burn to three radii with the least fuel: Enright & Conway 1991; an example of dymos."""
    m = pyo.ConcreteModel(name="two-burn orbit raise")
    guesses = {  # duration, its bounds, and first and last of radius, angle, radial and tangential speed
        "burn": (2.25, (0.5, 10), ((1, 1.5), (0, 1.7), (0, 0), (1, 1))),
        "coast": (3.0, (0.5, 50), ((1.3, 1.5), (2.1767, 1.7), (0.3285, 0), (0.97, 1))),
        "arrive": (1.75, (0.5, 10), ((1, 3), (0, 4), (0, 0), (1, sqrt(1 / 3)))),
    }
    start, target = (1, 0, 0, 1), (3, None, 0, sqrt(1 / 3))
    for name, (guess, bounds, ends) in guesses.items():
        time = rcp.Duration(bounds=bounds, initial_guess=guess)
        b = rcp.PhaseBlock(duration=time, mesh=mesh and mesh[name], elements=elements)
        m.add_component(name, b)
        line = [lambda s, a=a, c=c: a + (c - a) * s for a, c in ends]
        fixed = {"burn": {"initial": start}, "arrive": {"final": target}}.get(name, {})
        b.x = rcp.State(index=4, initial_guess=line, bounds=([0.1, None, None, None], None), **fixed)
        burns = name != "coast"
        if burns:
            first = name == "burn"
            b.push = rcp.State(initial=0.1 if first else None, initial_guess=lambda s: 0.1 - 0.1 * s)
            b.spent = rcp.State(
                initial=0 if first else None, initial_guess=lambda s, first=first: 0.1 * s + (0 if first else 0.1)
            )
            b.pitch = rcp.Control(bounds=(radians(-30), radians(30)) if first else (None, None))

        @b.ode
        def orbit(b, t, burns=burns):
            r, _, out, along = b.x[t]
            push, pitch = (b.push[t], b.pitch[t]) if burns else (0, 0)
            rates = [out, along / r, along**2 / r - 1 / r**2, -out * along / r]
            if not burns:
                return {b.x: rates}
            rates[2], rates[3] = rates[2] + push * pyo.sin(pitch), rates[3] + push * pyo.cos(pitch)
            return {b.x: rates, b.push: push**2 / 1.5, b.spent: push}

    m.off = rcp.Link(m.burn, m.coast, states=["x"])
    m.on = rcp.Link(m.coast, m.arrive, states=["x"])
    before, after = m.burn.final_time, m.arrive.initial_time
    m.same_push = pyo.Constraint(expr=m.burn.push[before] == m.arrive.push[after])
    m.same_spent = pyo.Constraint(expr=m.burn.spent[before] == m.arrive.spent[after])
    m.fuel = pyo.Objective(expr=m.arrive.spent[m.arrive.final_time])
    return m


def wind(x):
    """Along and, to be multiplied by the altitude, up; with the derivatives of both by the distance: feet, seconds."""
    a, b, c, d, e = 6e-8, -4e-11, -log(25 / 30.6) * 1e-12, -8.02881e-8, 6.28083e-11
    y, z = 4600 - x, x - 2300

    def by_place(near, amid, far, beyond):
        return pyo.Expr_if(
            IF_=x <= 500,
            THEN_=near,
            ELSE_=pyo.Expr_if(IF_=x <= 4100, THEN_=amid, ELSE_=pyo.Expr_if(IF_=x <= 4600, THEN_=far, ELSE_=beyond)),
        )

    along = by_place(-50 + a * x**3 + b * x**4, z / 40, 50 - a * y**3 - b * y**4, 50)
    along_rate = by_place(3 * a * x**2 + 4 * b * x**3, 1 / 40, 3 * a * y**2 + 4 * b * y**3, 0)
    bump = -51 * pyo.exp(-c * z**4)
    up = by_place(d * x**3 + e * x**4, bump, d * y**3 + e * y**4, 0)
    up_rate = by_place(3 * d * x**2 + 4 * e * x**3, -4 * c * z**3 * bump, -3 * d * y**2 - 4 * e * y**3, 0)
    return along, along_rate, up / 1000, up_rate / 1000


def abort_landing(mesh=None, elements=None):
    """The largest least altitude in a downburst: Bulirsch, Montrone & Pesch, JOTA 70 (1991) 1; Betts 2010.

    They give 491.852 ft; with the constants as they stand here a second transcription finds 502.213 ft as well.
    """
    m = pyo.ConcreteModel(name="abort landing in windshear")
    m.flight = b = rcp.PhaseBlock(duration=40, mesh=mesh, elements=elements)
    b.x = rcp.State(initial=0, bounds=(0, 10000), initial_guess=lambda t: 250 * t)
    b.h = rcp.State(initial=600, bounds=(0, None), initial_guess=600)
    b.v = rcp.State(initial=239.7, bounds=(1, None), initial_guess=239.7)
    b.path = rcp.State(initial=radians(-2.249), final=radians(7.431))
    b.attack = rcp.State(initial=radians(7.353), bounds=(None, radians(17.2)), initial_guess=radians(7.353))
    b.rate = rcp.Control(bounds=(radians(-3), radians(3)))
    b.lowest = rcp.Parameter(initial_guess=500)
    b.initialize_straight_lines()
    gravity, area, density, mass = 32.172, 1560.0, 0.002203, 150000 / 32.172

    @b.ode
    def aircraft(b, t):
        x, h, v, path, attack = b.x[t], b.h[t], b.v[t], b.path[t], b.attack[t]
        sine, cosine = pyo.sin(path), pyo.cos(path)
        along, along_rate, up, up_rate = wind(x)
        ground, climb = v * cosine + along, v * sine + up * h
        gust, lifted = along_rate * ground, up_rate * ground * h + up * climb
        power = pyo.Expr_if(IF_=0.3825 + 0.2 * t <= 1.0, THEN_=0.3825 + 0.2 * t, ELSE_=1.0)
        thrust = power * (44560 - 23.98 * v + 0.01442 * v**2) / mass
        excess = attack - radians(12)
        lift = 0.7125 + 6.0877 * attack + pyo.Expr_if(IF_=excess >= 0, THEN_=-9.0277 * excess**2, ELSE_=0)
        pressure = density * area * v**2 / (2 * mass)
        drag = pressure * (0.1552 + 0.12369 * attack + 2.4203 * attack**2)
        tilt = attack + radians(2)
        faster = thrust * pyo.cos(tilt) - drag - gravity * sine - (gust * cosine + lifted * sine)
        turn = thrust * pyo.sin(tilt) + pressure * lift - gravity * cosine + gust * sine - lifted * cosine
        return {b.x: ground, b.h: climb, b.v: faster, b.path: turn / v, b.attack: b.rate[t]}

    b.constraint(lambda b, t: b.h[t] >= b.lowest)
    m.altitude = pyo.Objective(expr=b.lowest, sense=pyo.maximize)
    return m
