"""A supersonic aircraft climbs to 65,600 feet and the speed of sound in the shortest time; its data are tables.

Bryson, Desai & Hoffman, J. Aircraft 6 (1969) 481, doi:10.2514/3.44093; with these tables and splines through their
points in the manual of PSOPT (Becerra, 2010): 318.8067 s
"""

from pathlib import Path

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = 318.8067
MACH = [0, 0.4, 0.8, 0.9, 1, 1.2, 1.4, 1.6, 1.8]
LIFT = rcp.Table(MACH, [3.44, 3.44, 3.44, 3.58, 4.44, 3.44, 3.01, 2.86, 2.44], name="lift")
DRAG = rcp.Table(MACH, [0.013, 0.013, 0.013, 0.014, 0.031, 0.041, 0.039, 0.036, 0.035], name="drag")
INDUCED = rcp.Table(MACH, [0.54, 0.54, 0.54, 0.75, 0.79, 0.78, 0.89, 0.93, 0.93], name="induced")
THRUST = rcp.Table.from_csv(Path(__file__).with_name("climb_thrust.csv"), outside="linear")  # Mach number, feet
KELVINS = 288.15 - 6.5e-3 * np.minimum(METRES := np.arange(-2000, 24000, 1000), 11000)
AIR = np.log(1.225 / 515.379 * (KELVINS / 288.15) ** 4.2559) - np.maximum(METRES - 11000, 0) / 6341.6
DENSITY = rcp.Table(METRES / 0.3048, AIR, name="logarithm of the density")
SOUND = rcp.Table(METRES / 0.3048, 20.0468 * np.sqrt(KELVINS) / 0.3048, name="sound")


def build(mesh=None, elements=None):
    """Altitude, speed, flight path and weight in feet, seconds and pounds; the angle of attack."""
    m = pyo.ConcreteModel(name="climb")
    m.climb = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(200, 500)), mesh=mesh, elements=elements)
    b.h, b.v = rcp.State(initial=0, final=65600, bounds=(0, 69000)), rcp.State(initial=424.26, final=968.148)
    b.path = rcp.State(initial=0, final=0, bounds=(-np.radians(89), np.radians(89)))
    b.weight = rcp.State(initial=42000, bounds=(0, 45000), initial_guess=lambda t: 42000 - 8400 * t)
    b.attack = rcp.Control(bounds=(-np.radians(20), np.radians(20)))
    b.initialize_straight_lines()

    @b.ode
    def aircraft(b, t):
        h, v, path, attack, mass = b.h[t], b.v[t], b.path[t], b.attack[t], b.weight[t] / 32.174
        mach, pressure, r = v / SOUND(h), 0.5 * pyo.exp(DENSITY(h)) * 530 * v**2, 20902900 + h
        thrust, slope, gravity = THRUST(mach, h), LIFT(mach), 0.14076539e17 / r**2
        drag = pressure * (DRAG(mach) + INDUCED(mach) * slope * attack**2)
        upward = thrust * pyo.sin(attack) + pressure * slope * attack
        turn = upward / (mass * v) + pyo.cos(path) * (v / r - gravity / v)
        faster = (thrust * pyo.cos(attack) - drag) / mass - gravity * pyo.sin(path)
        return {b.h: v * pyo.sin(path), b.v: faster, b.path: turn, b.weight: -thrust / 1600}

    m.time_taken = pyo.Objective(expr=b.duration)
    return m


def draw(figure, m):
    """Speed and altitude."""
    trajectory = m.climb.trajectory()
    figure.subplots(subplot_kw={"xlabel": "speed [ft/s]", "ylabel": "altitude [ft]"}).plot(trajectory.v, trajectory.h)


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED, elements=40)
