"""Swing up an acrobot: two links, a motor in the elbow only.

The published gravity terms contain the full length of the second link in place of the distance to its centre of mass.
They are kept for comparison; ``build(gravity_arm="physical")`` takes the centre of mass.

Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation,
ICRA 2022, doi:10.1109/ICRA46639.2022.9812069
"""

from __future__ import annotations

from math import pi

import numpy as np
import pyomo.environ as pyo
from mechanism_pictures import draw_linkage

import pyrobocop_pyomo as rcp

MASS = (0.5, 0.5)
LENGTH = (0.5, 0.5)
CENTRE = (0.2, 0.2)  # distance of each link's centre of mass from its joint
INERTIA = (0.5, 0.5)  # about the joint
GRAVITY = 9.81
GRAVITY_ARM = {"published": LENGTH[1], "physical": CENTRE[1]}


def accelerations(q1, q2, dq1, dq2, torque, arm):
    """Angular accelerations of both links; plain arithmetic."""
    coupling = MASS[1] * LENGTH[0] * CENTRE[1]
    m11 = INERTIA[0] + INERTIA[1] + MASS[1] * LENGTH[0] ** 2 + 2 * coupling * pyo.cos(q2)
    m12 = INERTIA[1] + coupling * pyo.cos(q2)
    m22 = INERTIA[1]
    coriolis = coupling * pyo.sin(q2)
    gravity_2 = MASS[1] * GRAVITY * arm * pyo.sin(q1 + q2)
    gravity_1 = (MASS[0] * CENTRE[0] + MASS[1] * LENGTH[0]) * GRAVITY * pyo.sin(q1) + gravity_2
    force_1 = coriolis * (2 * dq1 * dq2 + dq2**2) - gravity_1
    force_2 = torque - coriolis * dq1**2 - gravity_2
    determinant = m11 * m22 - m12**2
    return (m22 * force_1 - m12 * force_2) / determinant, (m11 * force_2 - m12 * force_1) / determinant


def build(
    elements: int = 100, stages: int = 1, scheme: str = "radau", gravity_arm: str = "published"
) -> pyo.ConcreteModel:
    """From hanging to standing upright in 5 seconds."""
    m = pyo.ConcreteModel(name="acrobot")
    m.swing = b = rcp.PhaseBlock(duration=5.0, elements=elements, scheme=scheme, stages=stages)
    # Bounds on derivatives keep them as variables. Without them Ipopt needs far fewer iterations from an initial guess
    # of zero, 52 instead of about 400, but ends in a slightly worse local optimum, 62.558 instead of 62.523.
    for name, final in (("q1", pi), ("q2", 0)):
        b.declare(name, rcp.State(initial=0, final=final, bounds=(-2 * pi, 2 * pi), derivative_bounds=(-40, 40)))
    for name in ("dq1", "dq2"):
        b.declare(name, rcp.State(initial=0, final=0, bounds=(-40, 40), derivative_bounds=(-40, 40)))
    b.torque = rcp.Control(bounds=(-40, 40))

    @b.ode
    def acrobot(b, t):
        ddq1, ddq2 = accelerations(b.q1[t], b.q2[t], b.dq1[t], b.dq2[t], b.torque[t], GRAVITY_ARM[gravity_arm])
        return {b.q1: b.dq1[t], b.q2: b.dq2[t], b.dq1: ddq1, b.dq2: ddq2}

    m.cost = pyo.Objective(
        expr=b.integral(
            lambda b, t: (b.q1[t] - pi) ** 2 + b.q2[t] ** 2 + 0.1 * (b.dq1[t] ** 2 + b.dq2[t] ** 2 + b.torque[t] ** 2)
        )
    )
    return m


def draw(figure, m: pyo.ConcreteModel) -> None:
    """Both links over time, and their signals."""
    trajectory = m.swing.trajectory()
    angles = np.stack([trajectory.q1, trajectory.q1 + trajectory.q2], axis=-1)
    links = np.array(LENGTH)[:, None] * np.stack([np.sin(angles), -np.cos(angles)], axis=-1)
    joints = np.concatenate([np.zeros((len(links), 1, 2)), np.cumsum(links, axis=1)], axis=1)
    left, right = figure.subfigures(1, 2)
    draw_linkage(trajectory.time, joints, title=m.name, figure=left)
    trajectory.plot(
        {"q1": "q1 [rad]", "q2": "q2 [rad]", "dq1": "dq1 [rad/s]", "torque": "torque [N m]"},
        figure=right,
    )


if __name__ == "__main__":
    from run_example import run_example

    cases = {"published": {}, "physical": {"gravity_arm": "physical"}}
    run_example(build, draw, cases=cases, default="published", coarse={"elements": 40}, size=(10, 5.4))
