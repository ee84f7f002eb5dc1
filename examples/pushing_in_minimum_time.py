"""Push a slider to its goal in the least time, with a finger that may stick or slip.

Slider, contact and goals are taken from `planar_pushing.py`; the duration is free, and is the objective. The published
formulation of minimum time multiplies the rates by the duration and keeps their bounds, which then hold per duration
and not per second: in the whole plan, however long it takes, the finger may slip by at most a quarter of the side. The
cases that end in ``scaled`` keep these bounds for comparison. Such problems have many local optima.

Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation,
ICRA 2022, sec. V-C, doi:10.1109/ICRA46639.2022.9812069
"""

from __future__ import annotations

import pyomo.environ as pyo
from planar_pushing import GOALS, draw, state_pusher_slider

import pyrobocop_pyomo as rcp

RATE_BOUNDS = {"x": 5.0, "y": 5.0, "theta": 5.0, "contact": 0.5}  # per duration


def build(
    goal: tuple[float, float, float] = GOALS["turn"], elements: int = 100, scaled: bool = False
) -> pyo.ConcreteModel:
    """The pusher-slider with a free duration, transcribed by implicit Euler."""
    m = pyo.ConcreteModel(name="pushing in minimum time")
    duration = rcp.Duration(bounds=(0.01, 100), initial_guess=10)
    m.push = b = rcp.PhaseBlock(duration=duration, elements=elements, scheme="implicit_euler")
    state_pusher_slider(b, goal)
    if scaled:

        @b.constraint
        def rates_per_duration(b, t):
            return {name: (-most, b.duration * b.derivative(name)[t], most) for name, most in RATE_BOUNDS.items()}

    m.cost = pyo.Objective(expr=b.duration)
    return m


def show(figure, m: pyo.ConcreteModel) -> None:
    """Slider, finger and forces, and how long it took."""
    draw(figure, m)
    figure.suptitle(f"{pyo.value(m.push.duration):.2f} s")


if __name__ == "__main__":
    from run_example import run_example

    cases = {name: {"goal": goal} for name, goal in GOALS.items()}
    cases |= {f"{name}-scaled": {"goal": goal, "scaled": True} for name, goal in GOALS.items()}
    run_example(build, show, cases=cases, default="turn", coarse={"elements": 15}, size=(6, 8))
