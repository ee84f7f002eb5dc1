"""Ride a moving belt: a mass at rest is put onto it, and has to stand still again further on, with least effort.

``v' = u + a sign(V - v)`` with the speed V of the belt. Friction drags the mass along until it sticks; riding is
free; to stop, the actuator works against friction. Over a braking time tau the effort of a steady force is ``tau (V /
tau + a)^2``: the best brake has ``tau = V / a``, a force of 2 a and the effort ``4 V a``. The distance is the one
that this ride covers.
"""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .detection import MOVING, detect_switches
from .filippov import Filippov
from .problem import NonsmoothProblem, at_boundaries, element_controls
from .switches import add_step

HORIZON, BELT, FRICTION = 3.0, 1.0, 2.0
DISTANCE = BELT * HORIZON - BELT**2 / FRICTION


def build(
    elements: int = 50, stages: int = 2, scheme: str = "radau", *, moving: bool = False, detect: bool = False
) -> pyo.ConcreteModel:
    """Rest to rest over DISTANCE."""
    m = pyo.ConcreteModel(name="belt")
    m.phase = b = rcp.PhaseBlock(
        duration=HORIZON,
        elements=elements,
        stages=stages,
        scheme=scheme,
        free_element_widths=MOVING if moving or detect else None,
    )
    b.x = rcp.State(initial=0, final=DISTANCE, initial_guess=lambda t: DISTANCE * t / HORIZON)
    b.v = rcp.State(initial=0, final=0, initial_guess=0.5)
    b.u = rcp.Control(bounds=(-10, 10), parametrization="piecewise_constant")
    add_step(b, "slower", lambda b, t: BELT - b.v[t])
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] + FRICTION * (2 * b.slower[t] - 1)})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    if detect:
        detect_switches(m)
    return m


def optimum() -> float:
    """Of the best brake."""
    return 4 * BELT * FRICTION


SYSTEM = Filippov(
    rates=lambda x, u, w: np.array([x[1], u + FRICTION * (2 * w - 1)]),
    surface=lambda x: BELT - x[1],
    gradient=lambda x: np.array([0.0, -1.0]),
)


def deviation(m: pyo.ConcreteModel) -> float:
    """From the motion under the plan's own control."""
    trajectory = m.phase.trajectory()
    states = at_boundaries(trajectory, "x", "v")
    true = SYSTEM.simulate(trajectory.grid.mesh.boundaries, element_controls(trajectory, "u"), states[0])
    return float(np.abs(states - true).max())


PROBLEM = NonsmoothProblem("belt", build, deviation, optimum, accuracy=(0.03, 0.06))
