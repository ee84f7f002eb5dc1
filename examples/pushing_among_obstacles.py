"""Push a slider into a slot between two squares, with a finger that may stick or slip.

The slider and its contact are taken from `planar_pushing.py`. It must keep 2 cm from both squares, which leaves it 5 mm
on either side in the slot of the case ``slot``. In ``turned-slot`` the duration is minimised, and the slider arrives
after three quarters of a turn, with the finger behind it. The squares of the publication stand 5 mm from its goal,
closer than the required distance: here they stand further apart, so that the slider has 3.5 cm on either side at the
goal. The publication also turns the shape opposite to the dynamics; here both turn by theta.

Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation and
Collision Avoidance, arXiv:2106.03220, sec. V and fig. 5
"""

from __future__ import annotations

from math import pi

import numpy as np
import pyomo.environ as pyo
from mechanism_pictures import draw_planar_pushing
from planar_pushing import SLIDER, squared_distance, state_pusher_slider

import pyrobocop_pyomo as rcp

CLEARANCE = 0.02
CASES = {
    "slot": {"goal": (0.5, 0.5, 0.0), "centres": [(0.5, 0.62), (0.5, 0.38)], "duration": 10.0},
    "turned-slot": {
        "goal": (0.45, -0.1, 3 * pi / 2),
        "centres": [(0.32, -0.1), (0.58, -0.1)],
        "duration": rcp.Duration(bounds=(1, 100), initial_guess=20),
    },
}


def build(case: str = "slot", elements: int = 100) -> pyo.ConcreteModel:
    """The pusher-slider among squares, transcribed by implicit Euler."""
    goal, duration = CASES[case]["goal"], CASES[case]["duration"]
    m = pyo.ConcreteModel(name="pushing among obstacles")
    m.push = b = rcp.PhaseBlock(duration=duration, elements=elements, scheme="implicit_euler")
    state_pusher_slider(b, goal)
    b.initialize_straight_lines()
    side = 2 * SLIDER.half_side
    m.squares = [rcp.Polytope.box(0.1, 0.1, center=centre) for centre in CASES[case]["centres"]]
    m.push.avoid = rcp.ObstacleAvoidanceBlock(
        b.time,
        bodies={
            "slider": rcp.Body(
                rcp.Polytope.box(side, side), pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t], b.theta[t])
            )
        },
        obstacles=m.squares,
        clearance=CLEARANCE,
    )
    m.cost = pyo.Objective(
        expr=b.duration if b.has_free_duration else b.integral(lambda b, t: squared_distance(b, t, goal))
    )
    return m


def draw(figure, m: pyo.ConcreteModel) -> None:
    """Slider, finger and squares, and how the finger pushes."""
    trajectory = m.push.trajectory()
    pose = np.column_stack([trajectory.x, trajectory.y, trajectory.theta])
    contact = SLIDER.half_side * np.column_stack([-np.ones_like(trajectory.contact), trajectory.contact])
    above, below = figure.subfigures(2, 1, height_ratios=(2.2, 1))
    draw_planar_pushing(
        trajectory.time,
        pose,
        contact,
        half_side=SLIDER.half_side,
        snapshots=10,
        title=m.name,
        obstacles=m.squares,
        figure=above,
    )
    trajectory.plot({"contact": "contact [-]", "normal": "normal [N]"}, figure=below)


if __name__ == "__main__":
    from run_example import run_example

    cases = {name: {"case": name} for name in CASES}
    run_example(build, draw, cases=cases, default="all", coarse={"elements": 52}, size=(10, 8))
