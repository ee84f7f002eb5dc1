"""The highest flight of a rocket through the air: full thrust, a singular arc, then none.

All quantities are scaled by their values at the start.

Dolan, More & Munson, Benchmarking Optimization Software with COPS 3.0, ANL/MCS-TM-273, 2004, problem 8: 1.01283
"""

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = 1.01283


def build(mesh=None, elements=None):
    """Height, speed and mass; the thrust; a free duration."""
    m = pyo.ConcreteModel(name="Goddard rocket")
    m.flight = b = rcp.PhaseBlock(
        duration=rcp.Duration(bounds=(0.01, 1), initial_guess=0.2), mesh=mesh, elements=elements
    )
    b.h = rcp.State(initial=1, bounds=(1, None), initial_guess=1)
    b.v = rcp.State(initial=0, bounds=(0, None), initial_guess=0.05)
    b.mass = rcp.State(initial=1, final=0.6, bounds=(0.6, 1), initial_guess=0.8)
    b.thrust = rcp.Control(bounds=(0, 3.5), initial_guess=1.7)

    @b.ode
    def rocket(b, t):
        drag = 310 * b.v[t] ** 2 * pyo.exp(500 * (1 - b.h[t]))
        acceleration = (b.thrust[t] - drag) / b.mass[t] - 1 / b.h[t] ** 2
        return {b.h: b.v[t], b.v: acceleration, b.mass: -b.thrust[t] / 0.5}

    m.height = pyo.Objective(expr=b.h[b.final_time], sense=pyo.maximize)
    return m


def draw(figure, m):
    """Height, speed and thrust."""
    m.flight.trajectory().plot({"h": "height", "v": "speed", "thrust": "thrust"}, figure=figure)


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED, elements=20)
