"""Hold a pendulum upright between two soft walls.

It starts a little off, its tip at a wall. A wall is a spring that acts while it is pressed in,
``0 <= force _|_ gap + force / stiffness >= 0``; the tip is at ``l sin(theta)``, so the gaps are
``d + l sin(theta)`` and ``d - l sin(theta)``.

``radau`` is implicit Euler. ``explicit`` is explicit Euler: equations, pairs, control and running cost then belong to
the start of each element, so that the last state is neither paid for nor kept out of the walls.

``thrown`` starts upright with a rate that the motor cannot stop in time: the left wall has to.

The published problem takes the moment of inertia as ``m g l^2``, and the walls' torque as force over ``l m``: two
mistakes, kept for comparison; ``build(physical=True)`` takes ``m l^2``, and force times lever ``l cos(theta)``.

Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation,
ICRA 2022, doi:10.1109/ICRA46639.2022.9812069
"""

from __future__ import annotations

from math import pi

import numpy as np
import pyomo.environ as pyo
from mechanism_pictures import draw_linkage

import pyrobocop_pyomo as rcp

MASS, LENGTH, GRAVITY = 0.1, 0.5, 9.81
STIFFNESS, DISTANCE = 1e5, 0.1  # of each wall, N/m; from the axis, m


def build(
    scheme: str = "radau",
    elements: int = 150,
    start: tuple[float, float] = (pi - 0.2, 0.0),
    physical: bool = False,
    strongest: float = 10.0,
) -> pyo.ConcreteModel:
    """From an angle and a rate near upright, in 7.5 seconds."""
    m = pyo.ConcreteModel(name="pendulum with soft walls")
    euler = "implicit_euler" if scheme == "radau" else "explicit_euler"
    m.hold = b = rcp.PhaseBlock(duration=7.5, elements=elements, scheme=euler)
    b.theta = rcp.State(initial=start[0], bounds=(-2 * pi, 2 * pi), initial_guess=pi - 0.2)  # hanging down is 0
    b.omega = rcp.State(initial=start[1], bounds=(-10, 10))
    b.torque = rcp.Control(bounds=(-strongest, strongest), initial_guess=2)
    b.left = rcp.mechanics.SoftWall(lambda b, t: DISTANCE + LENGTH * pyo.sin(b.theta[t]), STIFFNESS)
    b.right = rcp.mechanics.SoftWall(lambda b, t: DISTANCE - LENGTH * pyo.sin(b.theta[t]), STIFFNESS)

    @b.ode
    def pendulum(b, t):
        torque = b.torque[t] - MASS * GRAVITY * LENGTH * pyo.sin(b.theta[t])
        push = b.left[t] - b.right[t]
        if physical:
            return {b.theta: b.omega[t], b.omega: (torque + LENGTH * pyo.cos(b.theta[t]) * push) / (MASS * LENGTH**2)}
        return {b.theta: b.omega[t], b.omega: (torque + push / (LENGTH * MASS)) / (MASS * GRAVITY * LENGTH**2)}

    m.cost = pyo.Objective(
        expr=b.integral(lambda b, t: (b.theta[t] - pi) ** 2 + b.omega[t] ** 2 + 0.01 * b.torque[t] ** 2)
    )
    return m


def draw(figure, m: pyo.ConcreteModel) -> None:
    """The pendulum between its walls, and its signals."""
    trajectory = m.hold.trajectory()
    tip = LENGTH * np.stack([np.sin(trajectory.theta), -np.cos(trajectory.theta)], axis=-1)
    above, below = figure.subfigures(2, 1)
    draw_linkage(trajectory.time, np.stack([np.zeros_like(tip), tip], axis=1), title=m.name, figure=above)
    for wall in (-DISTANCE, DISTANCE):
        above.axes[0].axvline(wall, color="C3", linewidth=1)
    labels = {"theta": "angle [rad]", "omega": "rate [rad/s]", "torque": "torque [N m]", "left": "left wall [N]"}
    trajectory.plot(labels, figure=below)


if __name__ == "__main__":
    from run_example import run_example

    cases = {name: {"scheme": name} for name in ("radau", "explicit")}
    cases["thrown"] = {"physical": True, "start": (pi, 2.0), "strongest": 0.2}
    run_example(build, draw, cases=cases, default="all", coarse={"elements": 40}, size=(13, 8))
