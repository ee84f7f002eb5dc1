"""How to spend on finding and on holding cases while a resistant strain of tuberculosis spreads.

Jung, Lenhart & Feng, Optimal control of treatments in a two-strain tuberculosis model, Discrete and Continuous
Dynamical Systems B 2 (2002) 473, doi:10.3934/dcdsb.2002.2.473; Betts, Practical Methods for Optimal Control, 2nd ed.,
SIAM 2010, sec. 6.16: 5152.0731
"""

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = 5152.0731
PEOPLE = 30000
START = {"S": 76, "T": 1, "L1": 36, "L2": 2, "I1": 4, "I2": 1}  # of 120 parts of the people


def build(mesh=None, elements=None):
    """Susceptible, treated, latent and infectious people, the latter two by strain; two efforts."""
    m = pyo.ConcreteModel(name="two-strain tuberculosis")
    m.epidemic = b = rcp.PhaseBlock(duration=5, mesh=mesh, elements=elements)
    for name, parts in START.items():
        first = parts * PEOPLE / 120
        b.declare(name, rcp.State(initial=first, bounds=(0, PEOPLE), initial_guess=first))
    b.find = rcp.Control(bounds=(0.05, 0.95))
    b.hold = rcp.Control(bounds=(0.05, 0.95))

    @b.ode
    def spread(b, t):
        s, treated, l1, l2, i1, i2 = (getattr(b, name)[t] for name in START)
        find, lost = 2 * b.find[t], 1 - b.hold[t]
        typical, resistant = 13 * i1 / PEOPLE, 0.029 * i2 / PEOPLE
        leaving = 0.0143
        return {
            b.S: leaving * PEOPLE - (typical + resistant + leaving) * s,
            b.T: find * l1 + (1 - 0.5 * lost) * i1 - (leaving + typical + resistant) * treated,
            b.L1: typical * (s + treated) + 0.4 * lost * i1 - (leaving + 0.5 + find + resistant) * l1,
            b.L2: 0.1 * lost * i1 - (leaving + 1) * l2 + resistant * (s + l1 + treated),
            b.I1: 0.5 * l1 - (leaving + 1) * i1,
            b.I2: l2 - leaving * i2,
        }

    def cost(b, t):
        return b.L2[t] + b.I2[t] + 25 * b.find[t] ** 2 + 250 * b.hold[t] ** 2

    m.cost = pyo.Objective(expr=b.integral(cost))
    return m


def draw(figure, m):
    """Those with the resistant strain, and the efforts."""
    labels = {"L2": "latent, resistant", "I2": "infectious, resistant", "find": "finding", "hold": "holding"}
    m.epidemic.trajectory().plot(labels, figure=figure)


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED, elements=20)
