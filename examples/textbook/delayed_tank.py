"""Steer a stirred tank, whose contents act one second late and whose inlet acts two seconds late, at the least cost.

The history is a constant; kinks of the motion lie on element boundaries, one delay after the other.

Goellmann, Kern & Maurer, Optimal control problems with delays in state and control variables, Optimal Control
Applications and Methods 30 (2009) 341, doi:10.1002/oca.843: 2 + tanh 1 = 2.7615942
"""

from math import tanh

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = 2 + tanh(1)


def build(mesh=None, elements=None):
    """One state with a delay of 1 and one control with a delay of 2, over 3."""
    m = pyo.ConcreteModel(name="tank with delays")
    if mesh is None and elements is None:
        elements = 12
    m.tank = b = rcp.PhaseBlock(duration=3, mesh=mesh, elements=elements)
    b.x = rcp.State(initial=1, history=1, initial_guess=1)
    b.u = rcp.Control(history=0, parametrization="piecewise_linear")
    b.ode(lambda b, t: {b.x: b.x.delayed(t, 1) * b.u.delayed(t, 2)})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2))
    return m


def draw(figure, m):
    """State and control."""
    trajectory = m.tank.trajectory()
    axes = figure.subplots()
    axes.plot(trajectory.time, trajectory.x, label="contents")
    axes.plot(trajectory.points, trajectory.u, label="inlet")
    axes.set(xlabel="time", title=m.name)
    axes.legend()


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED, elements=12, coarse=6)
