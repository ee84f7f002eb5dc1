"""Swing a pendulum up with a motor that is barely stronger than gravity.

The published problem takes the moment of inertia as ``m g l^2``, although gravity does not belong
in an inertia. It is kept for comparison; ``build(inertia="physical")`` takes ``m l^2``.

Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation,
ICRA 2022, doi:10.1109/ICRA46639.2022.9812069
"""

from __future__ import annotations

from math import pi

import numpy as np
import pyomo.environ as pyo
from mechanism_pictures import draw_linkage

import pyrobocop_pyomo as rcp

MASS, LENGTH, DAMPING, GRAVITY = 1.0, 1.0, 0.01, 9.81
INERTIA = {"published": MASS * GRAVITY * LENGTH**2, "physical": MASS * LENGTH**2}


def build(elements: int = 150, stages: int = 1, scheme: str = "radau", inertia: str = "published") -> pyo.ConcreteModel:
    """Torque-limited swing-up in 7.5 seconds, the end left to the running cost."""
    m = pyo.ConcreteModel(name="pendulum")
    m.swing = b = rcp.PhaseBlock(duration=7.5, elements=elements, scheme=scheme, stages=stages)
    b.theta = rcp.State(initial=0, bounds=(-2 * pi, 2 * pi))  # hanging down is 0
    b.omega = rcp.State(initial=0, bounds=(-10, 10))
    b.torque = rcp.Control(bounds=(-10, 10))

    @b.ode
    def pendulum(b, t):
        gravity = MASS * GRAVITY * LENGTH * pyo.sin(b.theta[t])
        return {
            b.theta: b.omega[t],
            b.omega: (b.torque[t] - gravity - DAMPING * b.omega[t]) / INERTIA[inertia],
        }

    m.cost = pyo.Objective(
        expr=b.integral(lambda b, t: (b.theta[t] - pi) ** 2 + b.omega[t] ** 2 + 0.01 * b.torque[t] ** 2)
    )
    return m


def draw(figure, m: pyo.ConcreteModel) -> None:
    """The pendulum over time, and its signals."""
    trajectory = m.swing.trajectory()
    tip = LENGTH * np.stack([np.sin(trajectory.theta), -np.cos(trajectory.theta)], axis=-1)
    left, right = figure.subfigures(1, 2)
    draw_linkage(trajectory.time, np.stack([np.zeros_like(tip), tip], axis=1), title=m.name, figure=left)
    trajectory.plot({"theta": "angle [rad]", "omega": "rate [rad/s]", "torque": "torque [N m]"}, figure=right)


if __name__ == "__main__":
    from run_example import run_example

    cases = {"published": {}, "physical": {"inertia": "physical"}}
    run_example(build, draw, cases=cases, default="published", coarse={"elements": 40})
