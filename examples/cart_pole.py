"""Swing up a pole that hangs from a cart, and park the cart elsewhere.

Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation,
ICRA 2022, doi:10.1109/ICRA46639.2022.9812069
"""

from __future__ import annotations

from math import pi

import numpy as np
import pyomo.environ as pyo
from mechanism_pictures import draw_linkage

import pyrobocop_pyomo as rcp

CART, POLE, LENGTH, GRAVITY = 1.0, 1.0, 0.75, 9.8
GOAL = 0.5


def accelerations(theta, omega, force):
    """Acceleration of the cart and of the pole's angle; plain arithmetic."""
    s, c = pyo.sin(theta), pyo.cos(theta)
    moving = CART + POLE * s**2
    cart = (force + POLE * s * (LENGTH * omega**2 + GRAVITY * c)) / moving
    pole = (-force * c - POLE * LENGTH * omega**2 * c * s - (CART + POLE) * GRAVITY * s) / (LENGTH * moving)
    return cart, pole


def build(elements: int = 100, stages: int = 3, scheme: str = "radau") -> pyo.ConcreteModel:
    """From hanging at 3 m to standing at 0.5 m, in 3.3 seconds."""
    m = pyo.ConcreteModel(name="cart-pole")
    m.swing = b = rcp.PhaseBlock(duration=3.3, elements=elements, scheme=scheme, stages=stages)
    b.position = rcp.State(initial=3, final=GOAL, bounds=(-5, 5), initial_guess=3)
    b.theta = rcp.State(initial=0, final=pi, bounds=(-2 * pi, 2 * pi))
    b.velocity = rcp.State(initial=0, final=0, bounds=(-10, 10), derivative_bounds=(-100, 100))
    b.omega = rcp.State(initial=0, final=0, bounds=(-10, 10), derivative_bounds=(-100, 100))
    b.force = rcp.Control(bounds=(-20, 20), initial_guess=5)

    @b.ode
    def cart_pole(b, t):
        cart, pole = accelerations(b.theta[t], b.omega[t], b.force[t])
        return {b.position: b.velocity[t], b.theta: b.omega[t], b.velocity: cart, b.omega: pole}

    m.cost = pyo.Objective(
        expr=b.integral(
            lambda b, t: (
                (b.theta[t] - pi) ** 2
                + 0.1 * (b.velocity[t] ** 2 + b.omega[t] ** 2 + (b.position[t] - GOAL) ** 2)
                + 0.01 * b.force[t] ** 2
            )
        )
    )
    return m


def draw(figure, m: pyo.ConcreteModel) -> None:
    """Cart and pole over time, and their signals."""
    trajectory = m.swing.trajectory()
    cart = np.stack([trajectory.position, np.zeros_like(trajectory.position)], axis=-1)
    tip = cart + LENGTH * np.stack([np.sin(trajectory.theta), -np.cos(trajectory.theta)], axis=-1)
    left, right = figure.subfigures(1, 2)
    draw_linkage(trajectory.time, np.stack([cart, tip], axis=1), cart=(0.3, 0.15), title=m.name, figure=left)
    trajectory.plot({"position": "cart [m]", "theta": "angle [rad]", "force": "force [N]"}, figure=right)


if __name__ == "__main__":
    from run_example import run_example

    run_example(build, draw, cases={"published": {}}, default="published", coarse={"elements": 20}, size=(10, 3.8))
