"""Throw a puck so that it comes to rest at a target, with least energy: flight, impact, sliding with friction.

``x' = v, y' = w, v' = f, w' = n - g`` with ``0 <= n ⟂ y >= 0`` and Coulomb friction ``|f| <= mu n``. Nothing is
controlled after the throw. At the impact the floor takes the vertical speed w within one step, and friction up to
``mu w`` of the horizontal one; then the puck slides. A throw with (v, w) from the floor thus gets to ``2 v w / g + (v
- mu w)^2 / (2 mu g) = (v + mu w)^2 / (2 mu g)``: what reaches a distance d is the line ``v + mu w = sqrt(2 mu g d)``.

Implicit Euler with the gap itself in the pair is the time stepping of an inelastic impact: the force of one step stands
for the impulse.
"""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .detection import MOVING, detect_switches
from .problem import NonsmoothProblem, at_boundaries
from .switches import add_pair

HORIZON, DISTANCE, FRICTION, GRAVITY = 1.0, 1.0, 0.4, 10.0


def build(
    elements: int = 50, stages: int = 1, scheme: str = "radau", *, moving: bool = False, detect: bool = False
) -> pyo.ConcreteModel:
    """Forces per weight of the puck; the throw is its initial velocity."""
    m = pyo.ConcreteModel(name="throw")
    m.phase = b = rcp.PhaseBlock(
        duration=HORIZON,
        elements=elements,
        stages=stages,
        scheme=scheme,
        free_element_widths=MOVING if moving or detect else None,
    )
    b.x = rcp.State(initial=0, final=DISTANCE, initial_guess=lambda t: DISTANCE * t / HORIZON)
    b.y = rcp.State(initial=0, initial_guess=lambda t: 0.2)
    b.v = rcp.State(initial=(0.1, 5), final=0, initial_guess=1.5)
    b.w = rcp.State(initial=(0.1, 5), initial_guess=lambda t: max(0.0, 1.5 - 10 * t))
    b.normal = rcp.Algebraic(bounds=(0, None), initial_guess=0.5)
    b.friction_up = rcp.Algebraic(bounds=(0, None))
    b.friction_down = rcp.Algebraic(bounds=(0, None))
    b.speed = rcp.Algebraic(bounds=(0, None))

    @b.ode
    def puck(b, t):
        friction = b.friction_up[t] - b.friction_down[t]
        return {b.x: b.v[t], b.y: b.w[t], b.v: GRAVITY * friction, b.w: GRAVITY * (b.normal[t] - 1)}

    add_pair(b, "contact", lambda b, t: b.y[t], lambda b, t: b.normal[t])
    add_pair(b, "backward", lambda b, t: b.speed[t] + b.v[t], lambda b, t: b.friction_up[t])
    add_pair(b, "forward", lambda b, t: b.speed[t] - b.v[t], lambda b, t: b.friction_down[t])
    add_pair(
        b, "cone", lambda b, t: b.speed[t], lambda b, t: FRICTION * b.normal[t] - b.friction_up[t] - b.friction_down[t]
    )

    start = b.time.first()
    m.energy = pyo.Objective(expr=0.5 * (b.v[start] ** 2 + b.w[start] ** 2))
    if detect:
        detect_switches(m)
    return m


def optimum() -> float:
    """The smallest ``(v^2 + w^2) / 2`` on that line."""
    return FRICTION * GRAVITY * DISTANCE / (1 + FRICTION**2)


def motion(v: float, w: float, times: np.ndarray) -> np.ndarray:
    """Position and height after a throw, in closed form, shape ``(len(times), 2)``."""
    landing = 2 * w / GRAVITY
    slide = max(0.0, v - FRICTION * w)
    sliding = np.clip(times - landing, 0, slide / (FRICTION * GRAVITY))
    x = v * np.minimum(times, landing) + slide * sliding - 0.5 * FRICTION * GRAVITY * sliding**2
    y = np.where(times < landing, w * times - 0.5 * GRAVITY * times**2, 0.0)
    return np.column_stack([x, y])


def deviation(m: pyo.ConcreteModel) -> float:
    """From the closed form with the same throw; positions only, since speeds jump."""
    trajectory = m.phase.trajectory()
    true = motion(trajectory.v[0], trajectory.w[0], np.array(trajectory.grid.mesh.boundaries))
    return float(np.abs(at_boundaries(trajectory, "x", "y") - true).max())


PROBLEM = NonsmoothProblem("throw", build, deviation, optimum, accuracy=(0.1, 0.1))
