"""A robot that floats and is moved by four thrusters: from rest to rest with the least fuel, bang - off - bang.

Sakawa, Trajectory planning of a free-flying robot by using the optimal control, Optimal Control Applications and
Methods 20 (1999) 235; Betts, Practical Methods for Optimal Control, 2nd ed., SIAM 2010, sec. 6.13: 7.91014874
"""

from math import pi

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = 7.91014874


def build(mesh=None, elements=None):
    """A pose and its rates; two pairs of opposed thrusters."""
    m = pyo.ConcreteModel(name="free-flying robot")
    m.flight = b = rcp.PhaseBlock(duration=12, mesh=mesh, elements=elements)
    b.pose = rcp.State(index=["x", "y", "angle"], initial=[-10, -10, pi / 2], final=0)
    b.rate = rcp.State(index=["x", "y", "angle"], initial=0, final=0)
    b.thrust = rcp.Control(index=4, bounds=(0, 1))
    b.initialize_straight_lines()

    @b.ode
    def robot(b, t):
        u = b.thrust[t]
        left, right, angle = u[0] - u[1], u[2] - u[3], b.pose["angle", t]
        rates = [(left + right) * pyo.cos(angle), (left + right) * pyo.sin(angle), 0.2 * (left - right)]
        return {b.pose: b.rate[t], b.rate: rates}

    @b.constraint
    def opposed(b, t):
        u = b.thrust[t]
        return [u[0] + u[1] <= 1, u[2] + u[3] <= 1]

    m.fuel = pyo.Objective(expr=b.integral(lambda b, t: sum(b.thrust[t])))
    return m


def draw(figure, m):
    """The path with headings, and the thrusts."""
    trajectory = m.flight.trajectory()
    path, thrusts = figure.subplots(1, 2)
    x, y, angle = trajectory.pose
    path.plot(x, y)
    path.quiver(x[::9], y[::9], np.cos(angle[::9]), np.sin(angle[::9]), width=0.004)
    path.set(aspect="equal", title=m.name)
    for k, offset in enumerate((0, 1.2, 2.4, 3.6)):
        thrusts.plot(trajectory.points, trajectory.thrust[k] + offset)
    thrusts.set(xlabel="time", ylabel="thrusts, one above the other")


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED, elements=60, coarse=20)
