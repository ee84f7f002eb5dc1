"""Steer a ship home in the shortest time across a current that grows with the distance from the bank.

Zermelo, Zeitschrift fuer angewandte Mathematik und Mechanik 11 (1931) 114; Bryson & Ho, Applied Optimal Control, 1975,
sec. 2.7: from (3.66, -1.86), here to more digits, the heading turns from 105 to 240 degrees, in a time of
tan 240 - tan 105 = 5.4641
"""

from math import pi, radians, tan

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = tan(radians(240)) - tan(radians(105))


def build(mesh=None, elements=None):
    """A position, a heading, a free duration."""
    m = pyo.ConcreteModel(name="Zermelo's ship")
    m.way = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 20), initial_guess=5), mesh=mesh, elements=elements)
    b.x = rcp.State(initial=3.65866, final=0)
    b.y = rcp.State(initial=-1.86370, final=0)
    b.heading = rcp.Control(bounds=(0, 2 * pi), initial_guess=3)
    b.initialize_straight_lines()
    b.ode(lambda b, t: {b.x: pyo.cos(b.heading[t]) - b.y[t], b.y: pyo.sin(b.heading[t])})
    m.time_taken = pyo.Objective(expr=b.duration)
    return m


def draw(figure, m):
    """The way over the ground, and the heading."""
    trajectory = m.way.trajectory()
    way, heading = figure.subplots(1, 2)
    way.plot(trajectory.x, trajectory.y)
    way.set(xlabel="along the bank", ylabel="from the bank", title=m.name)
    heading.plot(trajectory.points, trajectory.heading)
    heading.set(xlabel="time", ylabel="heading [rad]")


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED)
