"""Reach a point as soon as possible: above a surface and, once it has caught the motion, along it.

``x' = -sign(x) + u`` and ``y' = 1 + sign(x) / 2`` with ``|u| <= 1/2``: nothing can leave the surface x = 0, on which
the motion slides with ``sign(x)`` replaced by u. It is fastest to come down as slowly as possible and then to slide
with ``y' = 1 + u / 2``. The same problem is written in two ways: by the Heaviside step, and by Stewart's shares of
two modes.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .detection import MOVING, detect_switches
from .filippov import Filippov
from .problem import NonsmoothProblem, at_boundaries, element_controls
from .switches import add_modes, add_step

START, GOAL, LARGEST = (1.0, 0.0), 4.0, 0.5


def build(
    elements: int = 50,
    stages: int = 2,
    scheme: str = "radau",
    *,
    moving: bool = False,
    detect: bool = False,
    writing: str = "step",
) -> pyo.ConcreteModel:
    """In minimal time from START to (0, GOAL)."""
    m = pyo.ConcreteModel(name=f"sliding by {writing}")
    duration = rcp.Duration(bounds=(0.5, 10), initial_guess=3)
    m.phase = b = rcp.PhaseBlock(
        duration=duration,
        elements=elements,
        stages=stages,
        scheme=scheme,
        free_element_widths=MOVING if moving or detect else None,
    )
    b.x = rcp.State(initial=START[0], final=0, initial_guess=lambda t: 1 - t)
    b.y = rcp.State(initial=START[1], final=GOAL, initial_guess=lambda t: GOAL * t)
    b.u = rcp.Control(bounds=(-LARGEST, LARGEST), parametrization="piecewise_constant")
    if writing == "step":
        add_step(b, "right", lambda b, t: b.x[t])
    else:
        add_modes(b, "mode", [lambda b, t: -b.x[t], lambda b, t: b.x[t]])

    @b.ode
    def switched(b, t):
        sign = 2 * b.right[t] - 1 if writing == "step" else b.mode_0[t] - b.mode_1[t]
        return {b.x: -sign + b.u[t], b.y: 1 + 0.5 * sign}

    m.time = pyo.Objective(expr=b.duration)
    if detect:
        detect_switches(m)
    return m


def optimum() -> float:
    """Down to the surface at the smallest rate, then along it."""
    down = START[0] / (1 - LARGEST)
    return down + (GOAL - 1.5 * down) / (1 + LARGEST / 2)


SYSTEM = Filippov(
    rates=lambda x, u, w: np.array([1 - 2 * w + u, 0.5 + w]),
    surface=lambda x: x[0],
    gradient=lambda x: np.array([1.0, 0.0]),
)


def deviation(m: pyo.ConcreteModel) -> float:
    """From the motion under the plan's own control."""
    trajectory = m.phase.trajectory()
    states = at_boundaries(trajectory, "x", "y")
    true = SYSTEM.simulate(trajectory.grid.mesh.boundaries, element_controls(trajectory, "u"), states[0])
    return float(np.abs(states - true).max())


STEP = NonsmoothProblem("sliding by step", build, deviation, optimum, accuracy=(0.01, 0.03))
MODES = NonsmoothProblem("sliding by modes", partial(build, writing="modes"), deviation, optimum, accuracy=(0.01, 0.03))
