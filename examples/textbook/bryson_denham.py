"""Turn a moving point back before a wall, with the least effort: a state constraint of second order.

The effort is 4 / (9 l) where the wall is at l; here l = 1/9, so the point rests at the wall for a while.

Bryson, Denham & Dreyfus, AIAA J. 1 (1963) 2544, doi:10.2514/3.2107; Bryson & Ho, Applied Optimal Control, sec. 3.11
"""

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = 4.0


def build(mesh=None, elements=None):
    """A double integrator with a wall."""
    m = pyo.ConcreteModel(name="Bryson-Denham problem")
    m.turn = b = rcp.PhaseBlock(duration=1, mesh=mesh, elements=elements)
    b.x = rcp.State(initial=0, final=0, bounds=(None, 1 / 9))
    b.v = rcp.State(initial=1, final=-1)
    b.u = rcp.Control()

    @b.ode
    def newton(b, t):
        return {b.x: b.v[t], b.v: b.u[t]}

    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 / 2))
    return m


def draw(figure, m):
    """Position and acceleration."""
    m.turn.trajectory().plot({"x": "position [m]", "u": "acceleration [m/s^2]"}, figure=figure)


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED)
