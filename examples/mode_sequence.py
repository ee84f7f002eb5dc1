"""Turn a slider around in minimum time by a fixed sequence of two pushes, first on one face, then on another.

Two things of the published problem are kept for comparison. The second push acts at the middle of the top face with the
force axes of the left face: its "normal" force runs along the face. And rates of the pose are bounded in normalised
time, that is per duration of their phase and not per second, which restricts long phases: without these bounds
(``build(rate_bound=None)``) the turn takes 7.1 instead of 12.9 seconds.

Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation,
ICRA 2022, sec. V-D, doi:10.1109/ICRA46639.2022.9812069
"""

from __future__ import annotations

from math import pi

import numpy as np
import pyomo.environ as pyo
from mechanism_pictures import draw_planar_pushing

import pyrobocop_pyomo as rcp

SLIDER = rcp.mechanics.SquareSlider()
FRICTION = 0.3
POSE_BOUNDS = {"x": (-5, 5), "y": (-5, 5), "theta": (-2 * pi, 2 * pi)}
CONTACTS = {"first": (-SLIDER.half_side, 0.0), "second": (0.0, SLIDER.half_side)}  # in the slider's frame


def build(
    elements: int = 200,
    stages: int = 1,
    scheme: str = "radau",
    goal: tuple[float, float, float] = (0.0, 0.0, pi),
    rate_bound: float | None = 5.0,
) -> pyo.ConcreteModel:
    """Two phases of free duration, joined in their pose; each has half of the elements."""
    m = pyo.ConcreteModel(name="mode sequence")
    grid = {"elements": elements // 2, "scheme": scheme, "stages": stages}
    m.first = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.01, 100), initial_guess=10), **grid)
    m.second = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.01, 200), initial_guess=20), **grid)
    state_push(m.first, CONTACTS["first"], initial=(0, 0, 0), rate_bound=rate_bound)
    state_push(m.second, CONTACTS["second"], final=goal, rate_bound=rate_bound)

    m.change_of_face = rcp.Link(m.first, m.second)
    m.total_time = pyo.Objective(expr=m.first.duration + m.second.duration)
    return m


def state_push(b, contact, initial=(None, None, None), final=(None, None, None), rate_bound=None) -> None:
    """Push at one point of the slider without slipping."""
    for (name, bounds), start, end in zip(POSE_BOUNDS.items(), initial, final, strict=True):
        b.declare(name, rcp.State(initial=start, final=end, bounds=bounds, initial_guess=0.0))
    b.normal = rcp.Control(bounds=(0, 0.5))
    b.tangential = rcp.Control(bounds=(-1, 1))

    @b.ode
    def pusher_slider(b, t):
        rates = SLIDER.velocity(b.theta[t], contact, (b.normal[t], b.tangential[t]))
        return dict(zip((b.x, b.y, b.theta), rates, strict=True))

    @b.constraint
    def friction_cone(b, t):
        return [b.tangential[t] <= FRICTION * b.normal[t], b.tangential[t] >= -FRICTION * b.normal[t]]

    if rate_bound is not None:

        @b.constraint
        def rates_in_normalised_time(b, t):
            return {name: (-rate_bound, b.duration * b.derivative(name)[t], rate_bound) for name in POSE_BOUNDS}


def draw(figure, m: pyo.ConcreteModel) -> None:
    """Slider and pusher in both phases, and their forces."""
    places = figure.subfigures(2, 2, height_ratios=(1.7, 1))
    for phase, snapshots, (above, below) in zip((m.first, m.second), (10, 5), places.T, strict=True):
        trajectory = phase.trajectory()
        pose = np.column_stack([trajectory.x, trajectory.y, trajectory.theta])
        draw_planar_pushing(
            trajectory.time,
            pose,
            np.tile(CONTACTS[phase.local_name], (len(pose), 1)),
            half_side=SLIDER.half_side,
            snapshots=snapshots,
            title=f"{phase.local_name} push, {trajectory.duration:.3f} s",
            figure=above,
        )
        trajectory.plot({"normal": "normal [N]", "tangential": "tangential [N]"}, figure=below)


if __name__ == "__main__":
    from run_example import run_example

    cases = {"published": {}, "precise": {"elements": 50, "stages": 3}, "unbounded rates": {"rate_bound": None}}
    run_example(build, draw, cases=cases, default="published", coarse={"elements": 40}, size=(10, 7))
