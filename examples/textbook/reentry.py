"""How far to the side a space shuttle can land: largest cross-range of a re-entry, in feet and seconds.

Betts, Practical Methods for Optimal Control Using Nonlinear Programming, 2nd ed., SIAM 2010,
doi:10.1137/1.9780898718577, sec. 6.1, without the limit on heating: 34.1412 degrees
"""

from math import degrees, radians

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = 34.1412
EARTH, GRAVITY, MASS, AREA = 20902900.0, 0.14076539e17, 203000 / 32.174, 2690.0


def build(mesh=None, elements=None):
    """Altitude, longitude, latitude, speed, flight path and azimuth; angle of attack and bank angle."""
    m = pyo.ConcreteModel(name="re-entry of a space shuttle")
    time = rcp.Duration(bounds=(100, 4000), initial_guess=2000)
    m.entry = b = rcp.PhaseBlock(duration=time, mesh=mesh, elements=elements)
    b.h = rcp.State(initial=260000, final=80000, bounds=(0, None))
    b.longitude, b.latitude = rcp.State(initial=0), rcp.State(initial=0, bounds=(-radians(89), radians(89)))
    b.v = rcp.State(initial=25600, final=2500, bounds=(1, None))
    b.path = rcp.State(initial=-radians(1), final=-radians(5), bounds=(-radians(89), radians(89)))
    b.azimuth = rcp.State(initial=radians(90))
    b.attack = rcp.Control(bounds=(-radians(90), radians(90)), initial_guess=radians(20))
    b.bank = rcp.Control(bounds=(-radians(89), radians(1)), initial_guess=-radians(50))
    b.initialize_straight_lines()

    @b.ode
    def shuttle(b, t):
        v, r, attack = b.v[t], EARTH + b.h[t], degrees(1) * b.attack[t]
        pressure = 0.5 * 0.002378 * pyo.exp(-b.h[t] / 23800) * v**2 * AREA / MASS
        lift = pressure * (-0.20704 + 0.029244 * attack)
        drag = pressure * (0.07854 - 0.0061592 * attack + 0.000621408 * attack**2)
        sin, cos = pyo.sin(b.path[t]), pyo.cos(b.path[t])
        east, north = cos * pyo.sin(b.azimuth[t]), cos * pyo.cos(b.azimuth[t])
        turn = lift * pyo.sin(b.bank[t]) / (v * cos) + v / r * east * pyo.tan(b.latitude[t])
        climb = lift / v * pyo.cos(b.bank[t]) + cos * (v / r - GRAVITY / (v * r**2))
        around = {b.longitude: v / r * east / pyo.cos(b.latitude[t]), b.latitude: v / r * north}
        return around | {b.azimuth: turn, b.h: v * sin, b.v: -drag - GRAVITY / r**2 * sin, b.path: climb}

    m.cross_range = pyo.Objective(expr=degrees(1) * b.latitude[b.final_time], sense=pyo.maximize)
    return m


def draw(figure, m):
    """Altitude over the ground track."""
    trajectory = m.entry.trajectory()
    axes = figure.subplots()
    axes.plot(np.degrees(trajectory.latitude), trajectory.h / 1000)
    axes.set(xlabel="latitude [deg]", ylabel="altitude [1000 ft]")


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED, elements=50, coarse=20)
