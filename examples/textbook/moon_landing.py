"""Land softly on the moon with the least fuel: fall freely, then brake at full thrust.

The switch follows from the height: the fuel is the square root of 68, in units of the source.

Meditch, On the problem of optimal thrust programming for a lunar soft landing, IEEE Trans. Automatic Control 9 (1964)
477, doi:10.1109/TAC.1964.1105758; with these numbers in the manual of GPOPS-II
"""

from math import sqrt

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = sqrt(68)


def build(mesh=None, elements=None):
    """Height and speed; the thrust; a free duration."""
    m = pyo.ConcreteModel(name="moon landing")
    m.descent = b = rcp.PhaseBlock(
        duration=rcp.Duration(bounds=(0.1, 100), initial_guess=4), mesh=mesh, elements=elements
    )
    b.height = rcp.State(initial=10, final=0, bounds=(0, None))
    b.speed = rcp.State(initial=-2, final=0)
    b.thrust = rcp.Control(bounds=(0, 3), initial_guess=1.5)
    b.initialize_straight_lines()
    b.ode(lambda b, t: {b.height: b.speed[t], b.speed: b.thrust[t] - 1.5})
    m.fuel = pyo.Objective(expr=b.integral(lambda b, t: b.thrust[t]))
    return m


def draw(figure, m):
    """Height, speed and thrust."""
    m.descent.trajectory().plot({"height": "height", "speed": "speed", "thrust": "thrust"}, figure=figure)


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED, elements=20)
