"""Follow a terrain with sharp peaks: four stiff states whose sum of squares has to stay above it.

Betts, Practical Methods for Optimal Control Using Nonlinear Programming, 2nd ed., SIAM 2010,
doi:10.1137/1.9780898718577, sec. 4.11.3: 2030.85609
"""

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = 2030.85609
A = np.array([[-10, 0, 0, 0], [0, -2, 0, 0], [0, 0, -3, 5], [0, 0, 5, -3]])
B = np.array([[1, 1], [1, 2], [1, -1], [1, 3]])
PEAKS = ((3, 3, 12), (3, 6, 10), (3, 10, 6), (8, 15, 4))  # height, time, sharpness


def terrain(t, exp=pyo.exp):
    """The least sum of squares."""
    return 0.01 + sum(height * exp(-sharpness * (t - place) ** 2) for height, place, sharpness in PEAKS)


def build(mesh=None, elements=None):
    """A linear system with a quadratic cost and one path constraint."""
    m = pyo.ConcreteModel(name="alp rider")
    m.ride = b = rcp.PhaseBlock(duration=20, mesh=mesh, elements=elements)
    b.y = rcp.State(index=4, initial=[2, 1, 2, 1], final=[2, 3, 1, -2])
    b.u = rcp.Control(index=2)
    b.initialize_straight_lines()
    b.ode(lambda b, t: {b.y: A @ b.y[t] + B @ b.u[t]})

    @b.constraint
    def above(b, t):
        return b.y[t] @ b.y[t] >= terrain(t)

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: 100 * b.y[t] @ b.y[t] + 0.01 * b.u[t] @ b.u[t]))
    return m


def draw(figure, m):
    """The sum of squares and the terrain."""
    trajectory = m.ride.trajectory()
    axes = figure.subplots()
    axes.plot(trajectory.time, (trajectory.y**2).sum(axis=0), label="sum of squares")
    axes.plot(trajectory.time, terrain(trajectory.time, np.exp), "--", label="terrain")
    axes.set(xlabel="time", title=m.name, ylim=(0, 11))
    axes.legend()


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED, elements=100, coarse=40)
