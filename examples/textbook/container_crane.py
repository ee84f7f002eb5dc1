"""Move a container by a crane so that it swings little and stands still at the end.

Sakawa & Shindo, Optimal control of container cranes, Automatica 18 (1982) 257, doi:10.1016/0005-1098(82)90086-3;
to two digits 0.0052; to more, on a fine mesh: 0.0051505
"""

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = 0.0051505
START, END = np.array([0, 22, 0, 0, -1, 0]), np.array([10, 14, 0, 2.5, 0, 0])


def build(mesh=None, elements=None):
    """Place of the trolley, length of the rope, swing, and their rates; two motors."""
    m = pyo.ConcreteModel(name="container crane")
    m.move = b = rcp.PhaseBlock(duration=9, mesh=mesh, elements=elements)
    reach = np.array([50, 50, 10, 2.5, 1, 10])
    b.x = rcp.State(index=6, initial=START, final=END, bounds=(-reach, reach))
    b.u = rcp.Control(index=2, bounds=([-2.83374, -0.80865], [2.83374, 0.71265]))
    b.initialize_straight_lines()

    @b.ode
    def crane(b, t):
        x, u = b.x[t], b.u[t]
        swing = -(u[0] + 27.0756 * x[2] + 2 * x[4] * x[5]) / x[1]
        return {b.x: [x[3], x[4], x[5], u[0] + 17.2656 * x[2], u[1], swing]}

    m.swing = pyo.Objective(expr=b.integral(lambda b, t: (b.x[2, t] ** 2 + b.x[5, t] ** 2) / 2))
    return m


def draw(figure, m):
    """The path of the container, and its swing."""
    trajectory = m.move.trajectory()
    path, swing = figure.subplots(1, 2)
    path.plot(trajectory.x[0] + trajectory.x[1] * np.sin(trajectory.x[2]), -trajectory.x[1] * np.cos(trajectory.x[2]))
    path.set(xlabel="along [m]", ylabel="up [m]", title=m.name)
    swing.plot(trajectory.time, np.degrees(trajectory.x[2]))
    swing.set(xlabel="time [s]", ylabel="swing [deg]")


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED, elements=40)
