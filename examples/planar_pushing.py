"""Push a square slider across a table with one finger that may stick or slip.

The finger pushes the left face. Its force lies within the friction cone. While the force is strictly inside, the finger
sticks; the finger slips along the face only at the edge of the cone: one complementarity pair per direction. The
optimiser finds when to stick and when to slip.

Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation,
ICRA 2022, sec. V-C and fig. 2, doi:10.1109/ICRA46639.2022.9812069
"""

from __future__ import annotations

from math import pi

import numpy as np
import pyomo.environ as pyo
from mechanism_pictures import draw_planar_pushing

import pyrobocop_pyomo as rcp

SLIDER = rcp.mechanics.SquareSlider()
FRICTION = 0.3
GOALS = {"turn": (0.0, 0.0, pi), "turn-and-shift": (0.0, 0.5, pi)}


def build(
    goal: tuple[float, float, float] = GOALS["turn"], elements: int = 100, duration: float = 10.0
) -> pyo.ConcreteModel:
    """The pusher-slider with sticking and slipping contact, transcribed by implicit Euler."""
    m = pyo.ConcreteModel(name="planar pushing")
    m.push = b = rcp.PhaseBlock(duration=duration, elements=elements, scheme="implicit_euler")
    state_pusher_slider(b, goal)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: squared_distance(b, t, goal)))
    return m


def state_pusher_slider(b, goal: tuple[float, float, float]) -> None:
    """States, forces and friction cone of a slider that starts at the origin and ends at the goal."""
    step = b.duration / b.grid.mesh.elements

    # The published bounds on rates, 5 m/s and 5 rad/s, are left out: with these forces they cannot be reached.
    b.x = rcp.State(initial=0, final=goal[0], bounds=(-5, 5))
    b.y = rcp.State(initial=0, final=goal[1], bounds=(-5, 5))
    b.theta = rcp.State(initial=0, final=goal[2], bounds=(-2 * pi, 2 * pi))
    b.contact = rcp.State(initial=0, final=(-0.5, 0.5), bounds=(-1, 1))  # along the left face, in half sides
    b.normal = rcp.Control(bounds=(0, 0.5))
    b.tangential = rcp.Control(bounds=(-1, 1))
    # Along the face, in half sides per second: only where the force is at the edge of its cone.
    b.slip = rcp.mechanics.CoulombSlip(b.normal, b.tangential, coefficient=FRICTION, fastest=0.5)

    @b.ode
    def pusher_slider(b, t):
        # The contact acts where it will be after the slip of this step: the look-ahead of the published model.
        contact = (-SLIDER.half_side, SLIDER.half_side * (b.contact[t] + step * b.slip[t]))
        v_x, v_y, omega = SLIDER.velocity(b.theta[t], contact, (b.normal[t], b.tangential[t]))
        return {b.x: v_x, b.y: v_y, b.theta: omega, b.contact: b.slip[t]}


def squared_distance(b, t, goal: tuple[float, float, float]):
    """From the goal, and of the finger from the middle of the face."""
    return (b.x[t] - goal[0]) ** 2 + (b.y[t] - goal[1]) ** 2 + (b.theta[t] - goal[2]) ** 2 + b.contact[t] ** 2


def draw(figure, m: pyo.ConcreteModel) -> None:
    """Slider and pusher over time, where the pusher touches, and with what force."""
    trajectory = m.push.trajectory()
    pose = np.column_stack([trajectory.x, trajectory.y, trajectory.theta])
    contact = SLIDER.half_side * np.column_stack([-np.ones_like(trajectory.contact), trajectory.contact])
    above, below = figure.subfigures(2, 1, height_ratios=(2.2, 1))
    draw_planar_pushing(trajectory.time, pose, contact, half_side=SLIDER.half_side, title=m.name, figure=above)
    trajectory.plot({"contact": "contact [-]", "normal": "normal [N]"}, figure=below)


if __name__ == "__main__":
    from run_example import run_example

    # On the 100 elements of the publication the turn is off by two percent within an element.
    cases = {"turn": {"elements": 160}, "turn-and-shift": {"goal": GOALS["turn-and-shift"]}}
    run_example(build, draw, cases=cases, default="all", coarse={"elements": 40}, size=(10, 8))
