"""The wire along which a bead slides down in the shortest time.

The bead starts at rest 10 m above the ground and ends 10 m further and 5 m lower; the angle of the wire is the control.

Bryson & Ho, Applied Optimal Control, 1975, sec. 2.7; with these numbers in the documentation of dymos (Falck et al.,
doi:10.21105/joss.02809): 1.8016 s
"""

from math import pi

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = 1.8016


def build(mesh=None, elements=None):
    """Three states, one angle, a free duration."""
    m = pyo.ConcreteModel(name="brachistochrone")
    m.slide = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 10), initial_guess=2), mesh=mesh, elements=elements)
    b.x = rcp.State(initial=0, final=10)
    b.y = rcp.State(initial=10, final=5)
    b.v = rcp.State(initial=0)
    b.angle = rcp.Control(bounds=(0, pi), initial_guess=0.8)
    b.initialize_straight_lines()
    b.initialize(v=5)

    @b.ode
    def bead(b, t):
        sin, cos = pyo.sin(b.angle[t]), pyo.cos(b.angle[t])
        return {b.x: b.v[t] * sin, b.y: -b.v[t] * cos, b.v: 9.80665 * cos}

    m.time_taken = pyo.Objective(expr=b.duration)
    return m


def draw(figure, m):
    """The wire, and the speed along it."""
    trajectory = m.slide.trajectory()
    wire, speed = figure.subplots(1, 2)
    wire.plot(trajectory.x, trajectory.y)
    wire.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title=m.name)
    speed.plot(trajectory.time, trajectory.v)
    speed.set(xlabel="time [s]", ylabel="speed [m/s]")


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED)
