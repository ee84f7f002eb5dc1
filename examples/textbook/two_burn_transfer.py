"""From a low inclined orbit to a geostationary one: coast, burn, coast, burn, in four phases of free duration.

Betts, Practical Methods for Optimal Control Using Nonlinear Programming, 2nd ed., SIAM 2010,
doi:10.1137/1.9780898718577, sec. 6.4: the final weight is 0.2367248 of the first
"""

from itertools import pairwise
from math import pi, radians

import pyomo.environ as pyo
from equinoctial import EARTH, NAMES, START, burning, coasting, declare, position

import pyrobocop_pyomo as rcp

PUBLISHED = 0.2367248
END = {"p": 19323 * 6076.1154855643 + EARTH, "f": 0, "g": 0, "h": 0, "k": 0}
PHASES = {  # a guess of the duration, its bounds, and of pitch and yaw of the thrust
    "coast": (2690, (2000, 3000), None),
    "burn": (150, (50, 500), (radians(0.148637e-2), radians(-9.08446))),
    "rise": (18810, (18000, 19700), None),
    "arrive": (50, (20, 200), (radians(-0.136658e-2), radians(49.7892))),
}


def build(mesh=None, elements=None):
    """Four linked phases; the two burns have a weight and two angles more."""
    m = pyo.ConcreteModel(name="two-burn transfer")
    ends = {}
    for name, (guess, bounds, angles) in PHASES.items():
        time = rcp.Duration(bounds=bounds, initial_guess=guess)
        b = rcp.PhaseBlock(duration=time, mesh=mesh and mesh[name], elements=elements)
        m.add_component(name, b)
        declare(b, START if name == "coast" else {}, END if name == "arrive" else {})
        if angles is not None:
            b.weight = rcp.State(initial=1 if name == "burn" else None, bounds=(0.01, 2))
            b.pitch, b.yaw = (rcp.Control(bounds=(-pi, pi), initial_guess=angle) for angle in angles)
        b.ode(coasting if angles is None else burning(thrust=1.2, impulse=300))
        states = NAMES if angles is None else (*NAMES, "weight")
        guess = b.simulate(initial={state: ends[state] for state in states if state in ends})
        b.initialize(guess)
        ends |= {state: float(getattr(guess, state)[-1]) for state in states}
    for before, after in pairwise(PHASES):
        m.add_component(f"to_{after}", rcp.Link(m.component(before), m.component(after), states=list(NAMES)))
    m.same_weight = pyo.Constraint(expr=m.burn.weight[m.burn.final_time] == m.arrive.weight[m.arrive.initial_time])
    m.left = pyo.Objective(expr=m.arrive.weight[m.arrive.final_time], sense=pyo.maximize)
    return m


def draw(figure, m):
    """The path in space, phase by phase."""
    axes = figure.subplots(subplot_kw={"projection": "3d"})
    for name in PHASES:
        axes.plot(*position(m.component(name).trajectory()))
    axes.set(xlabel="x [1000 km]", ylabel="y [1000 km]", zlabel="z [1000 km]", title=m.name)


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED, elements=10, coarse=8)
