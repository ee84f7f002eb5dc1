"""How to mix two catalysts along a reactor: bang, singular arc, bang.

Dolan, More & Munson, Benchmarking Optimization Software with COPS 3.0, ANL/MCS-TM-273, 2004, problem 14: 0.0480556
"""

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = 0.0480556


def build(mesh=None, elements=None):
    """Fractions of two substances; the third is what they leave, and what is wanted."""
    m = pyo.ConcreteModel(name="catalyst mixing")
    m.reactor = b = rcp.PhaseBlock(duration=1, mesh=mesh, elements=elements)
    b.x1 = rcp.State(initial=1, initial_guess=1)
    b.x2 = rcp.State(initial=0)
    b.u = rcp.Control(bounds=(0, 1), initial_guess=0.5)

    @b.ode
    def reactions(b, t):
        exchange = b.u[t] * (10 * b.x2[t] - b.x1[t])
        return {b.x1: exchange, b.x2: -exchange - (1 - b.u[t]) * b.x2[t]}

    end = b.final_time
    m.product = pyo.Objective(expr=1 - b.x1[end] - b.x2[end], sense=pyo.maximize)
    return m


def draw(figure, m):
    """The fractions and the mixture."""
    m.reactor.trajectory().plot({"x1": "first fraction", "x2": "second fraction", "u": "mixture"}, figure=figure)


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED, elements=20)
