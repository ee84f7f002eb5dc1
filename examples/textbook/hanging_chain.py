"""The shape of a chain of given length that hangs between two points: the least potential energy.

Dolan, More & Munson, Benchmarking Optimization Software with COPS 3.0, ANL/MCS-TM-273, 2004, problem 3: 5.06848
"""

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = 5.06848


def build(mesh=None, elements=None):
    """The height over the horizontal place, with its slope as control and its length as an integral constraint."""
    m = pyo.ConcreteModel(name="hanging chain")
    m.chain = b = rcp.PhaseBlock(duration=1, mesh=mesh, elements=elements)
    b.height = rcp.State(initial=1, final=3)
    b.slope = rcp.Control(initial_guess=2)
    b.initialize_straight_lines()
    b.ode(lambda b, t: {b.height: b.slope[t]})
    m.length = pyo.Constraint(expr=b.integral(lambda b, t: pyo.sqrt(1 + b.slope[t] ** 2)) == 4)
    m.energy = pyo.Objective(expr=b.integral(lambda b, t: b.height[t] * pyo.sqrt(1 + b.slope[t] ** 2)))
    return m


def draw(figure, m):
    """The chain."""
    trajectory = m.chain.trajectory()
    axes = figure.subplots()
    axes.plot(trajectory.time, trajectory.height)
    axes.set(xlabel="place", ylabel="height", title=m.name)


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED, elements=20)
