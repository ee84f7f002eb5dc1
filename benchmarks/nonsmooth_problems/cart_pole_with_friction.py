"""Swing up a pole on a cart that dry friction holds: nothing moves until the force exceeds it.

With pole of length one and mass 1/5 of the cart's, gravity 10 and ``F = u - 2 sign(v)``. What the optimum is, nobody
knows: the plan is assessed by the motion under its own forces.
"""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .detection import MOVING, detect_switches
from .filippov import Filippov
from .problem import NonsmoothProblem, at_boundaries, element_controls
from .switches import add_step

HORIZON, FRICTION, LARGEST, POLE, GRAVITY = 3.0, 2.0, 30.0, 0.2, 10.0


def accelerations(force, angle, rate, sine, cosine):
    """Of cart and pole, the angle measured from hanging."""
    cart = (force + POLE * sine * (rate**2 + GRAVITY * cosine)) / (1 + POLE * sine**2)
    return cart, -cart * cosine - GRAVITY * sine


def build(
    elements: int = 50, stages: int = 2, scheme: str = "radau", *, moving: bool = False, detect: bool = False
) -> pyo.ConcreteModel:
    """From hanging to standing, at rest, least squared force."""
    m = pyo.ConcreteModel(name="cart-pole with friction")
    m.phase = b = rcp.PhaseBlock(
        duration=HORIZON,
        elements=elements,
        stages=stages,
        scheme=scheme,
        free_element_widths=MOVING if moving or detect else None,
    )
    b.x = rcp.State(initial=0, final=0, bounds=(-2, 2))
    b.angle = rcp.State(initial=0, final=pi, bounds=(-2 * pi, 2 * pi), initial_guess=lambda t: pi * t / HORIZON)
    b.v = rcp.State(initial=0, final=0)
    b.rate = rcp.State(initial=0, final=0, initial_guess=1)
    b.u = rcp.Control(bounds=(-LARGEST, LARGEST), parametrization="piecewise_constant")
    add_step(b, "forward", lambda b, t: b.v[t])

    @b.ode
    def cart_pole(b, t):
        force = b.u[t] - FRICTION * (2 * b.forward[t] - 1)
        angle, rate = b.angle[t], b.rate[t]
        cart, pole = accelerations(force, angle, rate, pyo.sin(angle), pyo.cos(angle))
        return {b.x: b.v[t], b.angle: rate, b.v: cart, b.rate: pole}

    m.effort = pyo.Objective(expr=b.integral(lambda b, t: 0.01 * b.u[t] ** 2))
    if detect:
        detect_switches(m)
    return m


def _rates(x: np.ndarray, u: float, w: float) -> np.ndarray:
    cart, pole = accelerations(u - FRICTION * (2 * w - 1), x[1], x[3], sin(x[1]), cos(x[1]))
    return np.array([x[2], x[3], cart, pole])


SYSTEM = Filippov(_rates, surface=lambda x: x[2], gradient=lambda x: np.array([0.0, 0.0, 1.0, 0.0]))


def deviation(m: pyo.ConcreteModel) -> float:
    """From the motion under the plan's own force, each element from its own start: a pole falls off any plan."""
    trajectory = m.phase.trajectory()
    states = at_boundaries(trajectory, "x", "angle", "v", "rate")
    forces, times = element_controls(trajectory, "u"), trajectory.grid.mesh.boundaries
    ends = [SYSTEM.simulate(times[i : i + 2], forces[i : i + 1], states[i])[-1] for i in range(len(forces))]
    return float(np.abs(states[1:] - np.array(ends)).max())


PROBLEM = NonsmoothProblem("cart-pole with friction", build, deviation, optimum=None, accuracy=(0.0, 1.0))
