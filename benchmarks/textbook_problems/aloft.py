"""A glider in the wind, a rocket in three phases and a station in orbit."""

from __future__ import annotations

from math import cos, pi, radians, sin

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

INERTIA = (
    (2.80701911616e7, 4.822509936e5, -1.71675094448e7),
    (4.822509936e5, 9.5144639344e7, 6.02604448e4),
    (-1.71675094448e7, 6.02604448e4, 7.6594401336e7),
)


def dynamic_soaring(mesh=None, elements=None):
    """The least gradient of wind that carries a glider in a circle: Zhao 2004; GPOPS-II, also the guess; in feet."""
    m = pyo.ConcreteModel(name="dynamic soaring")
    m.flight = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(1, 30), initial_guess=24), mesh=mesh, elements=elements)
    turn = 2 * pi
    b.x = rcp.State(initial=0, final=0, bounds=(-1000, 1000), initial_guess=lambda s: 500 * cos(turn * s) - 500)
    b.y = rcp.State(initial=0, final=0, bounds=(-1000, 1000), initial_guess=lambda s: 300 * sin(turn * s))
    b.z = rcp.State(initial=0, final=0, bounds=(0, 1000), initial_guess=lambda s: 400 - 400 * cos(turn * s))
    b.v = rcp.State(bounds=(10, 350), initial_guess=lambda s: 80 * (1.5 + cos(turn * s)))
    b.path = rcp.State(bounds=(-radians(75), radians(75)), initial_guess=lambda s: pi / 6 * sin(turn * s))
    b.heading = rcp.State(bounds=(-3 * pi, pi / 2), initial_guess=lambda s: -1 - 6 * s)
    b.lift = rcp.Control(bounds=(-0.5, 1.5), initial_guess=0.5)
    b.bank = rcp.Control(bounds=(-radians(75), radians(75)), initial_guess=-1)
    b.gradient = rcp.Parameter(bounds=(0.005, 0.15), initial_guess=0.08)
    gravity, factor = 32.2, 0.5 * 0.002378 * 45.09703 / 5.6

    @b.ode
    def glider(b, t):
        v, lift = b.v[t], b.lift[t]
        up, level = pyo.sin(b.path[t]), pyo.cos(b.path[t])
        east, north = pyo.sin(b.heading[t]), pyo.cos(b.heading[t])
        gust = b.gradient * v * up
        drag, pull = factor * v**2 * (0.00873 + 0.045 * lift**2), factor * v**2 * lift
        return {
            b.x: v * level * east + b.gradient * b.z[t],
            b.y: v * level * north,
            b.z: v * up,
            b.v: -drag - gravity * up - gust * level * east,
            b.path: (pull * pyo.cos(b.bank[t]) - gravity * level + gust * up * east) / v,
            b.heading: (pull * pyo.sin(b.bank[t]) - gust * north) / (v * level),
        }

    b.constraint(lambda b, t: (-2, factor * b.v[t] ** 2 * b.lift[t] / gravity, 5))
    first, last = b.initial_time, b.final_time
    m.same_speed = pyo.Constraint(expr=b.v[first] == b.v[last])
    m.same_path = pyo.Constraint(expr=b.path[first] == b.path[last])
    m.around = pyo.Constraint(expr=b.heading[last] == b.heading[first] - turn)
    m.least = pyo.Objective(expr=b.gradient)
    return m


def drag(h, v):
    """Of the sounding rocket, in pounds."""
    return 5.4915348492338101e-5 * v**2 * pyo.exp(-h / 23800)


def sounding_rocket(mesh=None, elements=None):
    """Full thrust, the singular arc and none, in three phases: Betts 2010, sec. 4.15; an example of GPOPS; in feet."""
    m = pyo.ConcreteModel(name="sounding rocket in three phases")
    gravity, speed = 32.174, 1580.9425279876559
    for name, thrust in (("boost", 193.044), ("singular", None), ("coast", 0.0)):
        time = rcp.Duration(bounds=(1, 50), initial_guess=15)
        b = rcp.PhaseBlock(duration=time, mesh=mesh and mesh[name], elements=elements)
        m.add_component(name, b)
        starts = name == "boost"
        b.h = rcp.State(initial=0 if starts else None, bounds=(0, 30000), initial_guess=lambda s: 10000 * s)
        b.v = rcp.State(initial=0 if starts else None, final=0 if name == "coast" else None, initial_guess=500)
        b.mass = rcp.State(
            initial=3 if starts else None, final=1 if name == "coast" else None, bounds=(1, 3), initial_guess=2
        )
        if thrust is None:
            b.thrust = rcp.Control(bounds=(0, 193.044), initial_guess=100)

        @b.ode
        def rise(b, t, thrust=thrust):
            h, v, mass = b.h[t], b.v[t], b.mass[t]
            push = b.thrust[t] if thrust is None else thrust
            return {b.h: v, b.v: (push - drag(h, v)) / mass - gravity, b.mass: -push / speed}

    @m.singular.constraint
    def stays_singular(b, t):
        h, v, weight = b.h[t], b.v[t], b.mass[t] * gravity
        ratio = speed / v
        more = (speed**2 / (23800 * gravity) * (1 + 1 / ratio) - 1 - 2 * ratio) / (1 + 4 * ratio + 2 * ratio**2)
        return b.thrust[t] == drag(h, v) + weight * (1 + more)

    b, start = m.singular, m.singular.initial_time
    m.onto = rcp.Link(m.boost, m.singular, states=["h", "v", "mass"])
    m.off = rcp.Link(m.singular, m.coast, states=["h", "v", "mass"])
    m.begins = pyo.Constraint(expr=b.mass[start] * gravity == (1 + b.v[start] / speed) * drag(b.h[start], b.v[start]))
    m.altitude = pyo.Objective(expr=m.coast.h[m.coast.final_time], sense=pyo.maximize)
    return m


def _cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _applied(matrix, vector):
    return [sum(entry * value for entry, value in zip(row, vector, strict=True)) for row in matrix]


def _turning(attitude, rate, momentum):
    """Rates of Rodrigues' parameters, and what turns the station beside its gyroscopes' torque."""
    orbit, r = radians(0.06511), attitude
    square = sum(value**2 for value in r)
    columns = []
    for unit in ([0, 1, 0], [0, 0, 1]):
        once = _cross(r, unit)
        twice = _cross(r, once)
        columns.append([u + 2 / (1 + square) * (c - a) for u, c, a in zip(unit, twice, once, strict=True)])
    across, down = columns
    relative = [w + orbit * c for w, c in zip(rate, across, strict=True)]
    along = sum(value * w for value, w in zip(r, relative, strict=True))
    turned = _cross(r, relative)
    attitude_rate = [(value * along + w + c) / 2 for value, w, c in zip(r, relative, turned, strict=True)]
    gravity = [3 * orbit**2 * value for value in _cross(down, _applied(INERTIA, down))]
    total = [a + h for a, h in zip(_applied(INERTIA, rate), momentum, strict=True)]
    torque = [g - c for g, c in zip(gravity, _cross(rate, total), strict=True)]
    return attitude_rate, torque


def space_station(mesh=None, elements=None):
    """Empty gyroscopes by gravity in half an hour: Betts 2010, sec. 6.7, with a state for the cost: 3.586751."""
    m = pyo.ConcreteModel(name="attitude of a space station")
    m.turn = b = rcp.PhaseBlock(duration=1800, mesh=mesh, elements=elements)
    rate, attitude = [-9.5380685844896e-6, -1.1363312657036e-3, 5.3472801108427e-6], [
        2.9963689649816e-3, 1.5334477761054e-1, 3.8359805613992e-3,
    ]  # fmt: skip
    b.rate = rcp.State(index=3, initial=rate, bounds=(-2e-3, 2e-3), initial_guess=rate)
    b.attitude = rcp.State(index=3, initial=attitude, bounds=(-1, 1), initial_guess=attitude)
    b.momentum = rcp.State(index=3, initial=5000, final=0, bounds=(-15000, 15000), initial_guess=5000)
    b.torque = rcp.Control(index=3, bounds=(-150, 150))
    inverse = np.linalg.inv(np.array(INERTIA)).tolist()

    @b.ode
    def station(b, t):
        attitude_rate, torque = _turning(list(b.attitude[t]), list(b.rate[t]), list(b.momentum[t]))
        left = [each - u for each, u in zip(torque, b.torque[t], strict=True)]
        return {b.rate: _applied(inverse, left), b.attitude: attitude_rate, b.momentum: b.torque[t]}

    b.constraint(lambda b, t: b.momentum[t] @ b.momentum[t] <= 1e8)
    end = b.final_time
    attitude_rate, torque = _turning(list(b.attitude[end]), list(b.rate[end]), list(b.momentum[end]))
    m.steady = pyo.ConstraintList()
    for value in (*attitude_rate, *_applied(inverse, torque)):
        m.steady.add(value == 0)
    m.effort = pyo.Objective(expr=1e-6 * b.integral(lambda b, t: b.torque[t] @ b.torque[t]))
    return m
