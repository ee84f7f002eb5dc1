"""The largest circular orbit that a small constant thrust reaches in a given time.

Moyer & Pinkham, in: Computing Methods in Optimization Problems, 1964; Bryson & Ho, Applied Optimal Control, 1975,
sec. 2.5: from Earth's orbit in 193 days, r = 1.5253
"""

from math import pi

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = 1.5253


def build(mesh=None, elements=None):
    """Radius, angle and two velocities in units of the first orbit; the direction of the thrust."""
    m = pyo.ConcreteModel(name="orbit raising")
    m.transfer = b = rcp.PhaseBlock(duration=3.3207, mesh=mesh, elements=elements)
    b.r = rcp.State(initial=1, bounds=(0.5, 3), initial_guess=1.2)
    b.angle = rcp.State(initial=0, initial_guess=lambda t: 0.7 * t)
    b.u = rcp.State(initial=0, final=0)
    b.v = rcp.State(initial=1, initial_guess=0.9)
    b.direction = rcp.Control(bounds=(-pi, 2 * pi), initial_guess=1)

    @b.ode
    def orbit(b, t):
        thrust = 0.1405 / (1 - 0.0749 * t)
        outward = b.v[t] ** 2 / b.r[t] - 1 / b.r[t] ** 2 + thrust * pyo.sin(b.direction[t])
        around = -b.u[t] * b.v[t] / b.r[t] + thrust * pyo.cos(b.direction[t])
        return {b.r: b.u[t], b.angle: b.v[t] / b.r[t], b.u: outward, b.v: around}

    end = b.final_time
    m.circle = pyo.Constraint(expr=b.v[end] ** 2 * b.r[end] == 1)
    m.radius = pyo.Objective(expr=b.r[end], sense=pyo.maximize)
    return m


def draw(figure, m):
    """The path around the sun, and the direction of the thrust."""
    trajectory = m.transfer.trajectory()
    path, direction = figure.subplots(1, 2)
    path.plot(trajectory.r * np.cos(trajectory.angle), trajectory.r * np.sin(trajectory.angle))
    path.plot(0, 0, "o")
    path.set(aspect="equal", title=m.name)
    direction.plot(trajectory.points, np.degrees(trajectory.direction))
    direction.set(xlabel="time", ylabel="direction [deg]")


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED, elements=20)
