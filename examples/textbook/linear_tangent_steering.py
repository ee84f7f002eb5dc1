"""Reach a height and a horizontal speed in the shortest time, by the direction of a constant thrust alone.

The tangent of the optimal direction is linear in time.

Bryson & Ho, Applied Optimal Control, 1975, sec. 2.4; Dolan, More & Munson, COPS 3.0, ANL/MCS-TM-273, 2004,
problem 10 (particle steering): 0.554577
"""

from math import pi

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = 0.554577


def build(mesh=None, elements=None):
    """A point mass in a plane."""
    m = pyo.ConcreteModel(name="linear tangent steering")
    m.flight = b = rcp.PhaseBlock(
        duration=rcp.Duration(bounds=(0.01, 10), initial_guess=1), mesh=mesh, elements=elements
    )
    b.r = rcp.State(index=["x", "y"], initial=0, final=[None, 5])
    b.v = rcp.State(index=["x", "y"], initial=0, final=[45, 0])
    b.direction = rcp.Control(bounds=(-pi / 2, pi / 2))

    @b.ode
    def thrust(b, t):
        return {b.r: b.v[t], b.v: [100 * pyo.cos(b.direction[t]), 100 * pyo.sin(b.direction[t])]}

    m.time_taken = pyo.Objective(expr=b.duration)
    return m


def draw(figure, m):
    """The path and the direction."""
    trajectory = m.flight.trajectory()
    path, direction = figure.subplots(1, 2)
    path.plot(*trajectory.r)
    path.set(xlabel="x", ylabel="y", title=m.name)
    direction.plot(trajectory.points, trajectory.direction)
    direction.set(xlabel="time", ylabel="direction [rad]")


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED)
