"""When to send the fleet: predators and prey come into balance by fishing with all or with none of the boats.

The control is 0 or 1. Relaxed, the deviation is 1.34408; with finer switching it comes arbitrarily close to this value,
and the integral gap of the rounding bounds the difference.

Sager, Numerical Methods for Mixed-Integer Optimal Control Problems, 2005, sec. 1.4; the collection mintOC.de: 1.34408
"""

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = 1.34408


def build(mesh=None, elements=None):
    """Both kinds of fish, and the fleet."""
    m = pyo.ConcreteModel(name="fishing")
    m.sea = b = rcp.PhaseBlock(duration=12, mesh=mesh, elements=elements)
    b.prey = rcp.State(initial=0.5, initial_guess=1)
    b.predators = rcp.State(initial=0.7, initial_guess=1)
    b.fleet = rcp.Control(integer=(0, 1), initial_guess=0.5)

    @b.ode
    def sea(b, t):
        x, y, w = b.prey[t], b.predators[t], b.fleet[t]
        return {b.prey: x - x * y - 0.4 * x * w, b.predators: -y + x * y - 0.2 * y * w}

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.prey[t] - 1) ** 2 + (b.predators[t] - 1) ** 2))
    return m


def draw(figure, m):
    """The fish, and when the fleet is out."""
    trajectory = m.sea.trajectory()
    fish, fleet = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    fish.plot(trajectory.time, trajectory.prey, label="prey")
    fish.plot(trajectory.time, trajectory.predators, label="predators")
    fish.set(title=m.name)
    fish.legend()
    fleet.step(trajectory.points, trajectory.fleet, where="pre")
    fleet.set(xlabel="time", ylabel="fleet")


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED, elements=200, coarse=60)
