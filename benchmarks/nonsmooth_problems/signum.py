"""Choose the start of ``x' = 2 - sign(x)``: the smallest problem on which a fixed mesh misleads an optimiser.

Min ``integral of x^2 + (x(2) - 5/3)^2`` over ``x(0)``. While an element has x changing its sign, the discretised
cost, seen as a function of x(0), has a slope that is wrong however fine the mesh is, and a local minimum in every
element; only a relaxation that lets go of the switch finds the way past them.

Stewart & Anitescu, Optimal control of systems with discontinuous differential equations, Numer. Math. 114 (2010),
doi:10.1007/s00211-009-0262-2
"""

from __future__ import annotations

from math import sqrt

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .detection import MOVING, detect_switches
from .problem import NonsmoothProblem, at_boundaries
from .switches import add_step

HORIZON, TARGET = 2.0, 5 / 3


def build(
    elements: int = 50, stages: int = 2, scheme: str = "radau", *, moving: bool = False, detect: bool = False
) -> pyo.ConcreteModel:
    """The start is free; there is no control."""
    m = pyo.ConcreteModel(name="signum")
    m.phase = b = rcp.PhaseBlock(
        duration=HORIZON,
        elements=elements,
        stages=stages,
        scheme=scheme,
        free_element_widths=MOVING if moving or detect else None,
    )
    b.x = rcp.State(initial=(-2, 0), initial_guess=0)
    add_step(b, "positive", lambda b, t: b.x[t])
    b.ode(lambda b, t: {b.x: 3 - 2 * b.positive[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2) + (b.x[b.time.last()] - TARGET) ** 2)
    if detect:
        detect_switches(m, at_start={("positive_off", None): -b.x[b.time.first()]})
    return m


def optimum() -> float:
    """With ``x(0) = -3 s`` the switch is at s and the cost is ``3 s^3 + (2 - s)^3 / 3 + (1/3 - s)^2``."""
    s = (-6 + sqrt(36 + 32 * 14 / 3)) / 16
    return 3 * s**3 + (HORIZON - s) ** 3 / 3 + (HORIZON - s - TARGET) ** 2


def motion(start: float, times: np.ndarray) -> np.ndarray:
    """From a negative start, in closed form."""
    switch = -start / 3
    return np.where(times < switch, start + 3 * times, times - switch)


def deviation(m: pyo.ConcreteModel) -> float:
    """From the closed form with the same start."""
    trajectory = m.phase.trajectory()
    x = at_boundaries(trajectory, "x")[:, 0]
    return float(np.abs(x - motion(x[0], np.array(trajectory.grid.mesh.boundaries))).max())


PROBLEM = NonsmoothProblem("signum", build, deviation, optimum, accuracy=(0.04, 0.06))
