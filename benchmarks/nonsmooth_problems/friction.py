"""A block on a rough floor, from rest to rest in minimal time: ``v' = u - sign(v)``, ``|u| <= 3``.

Friction helps to brake: the best plan accelerates with 2 and brakes with 4, and stops exactly where friction would
hold it.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .detection import MOVING, detect_switches
from .filippov import Filippov
from .problem import NonsmoothProblem, at_boundaries, element_controls
from .switches import add_step

DISTANCE, FRICTION, LARGEST = 2.0, 1.0, 3.0


def build(
    elements: int = 50, stages: int = 2, scheme: str = "radau", *, moving: bool = False, detect: bool = False
) -> pyo.ConcreteModel:
    """Rest to rest over DISTANCE."""
    m = pyo.ConcreteModel(name="braking with friction")
    duration = rcp.Duration(bounds=(0.5, 10), initial_guess=3)
    m.phase = b = rcp.PhaseBlock(
        duration=duration,
        elements=elements,
        stages=stages,
        scheme=scheme,
        free_element_widths=MOVING if moving or detect else None,
    )
    b.x = rcp.State(initial=0, final=DISTANCE, initial_guess=lambda t: DISTANCE * t)
    b.v = rcp.State(initial=0, final=0, initial_guess=1)
    b.u = rcp.Control(bounds=(-LARGEST, LARGEST), parametrization="piecewise_constant")
    add_step(b, "forward", lambda b, t: b.v[t])
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - FRICTION * (2 * b.forward[t] - 1)})
    m.time = pyo.Objective(expr=b.duration)
    if detect:
        detect_switches(m)
    return m


def optimum() -> float:
    """Bang-bang with two different accelerations."""
    faster, slower = LARGEST - FRICTION, LARGEST + FRICTION
    return sqrt(2 * DISTANCE * (faster + slower) / (faster * slower))


SYSTEM = Filippov(
    rates=lambda x, u, w: np.array([x[1], u - FRICTION * (2 * w - 1)]),
    surface=lambda x: x[1],
    gradient=lambda x: np.array([0.0, 1.0]),
)


def deviation(m: pyo.ConcreteModel) -> float:
    """From the motion under the plan's own control."""
    trajectory = m.phase.trajectory()
    states = at_boundaries(trajectory, "x", "v")
    true = SYSTEM.simulate(trajectory.grid.mesh.boundaries, element_controls(trajectory, "u"), states[0])
    return float(np.abs(states - true).max())


PROBLEM = NonsmoothProblem("braking with friction", build, deviation, optimum, accuracy=(0.01, 0.06))
