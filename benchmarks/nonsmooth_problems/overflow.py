"""Two tanks: the first one runs over into the second, which leaks.

``g' = u - q`` and ``h' = q - h``, with ``0 <= q ⟂ 1 - g >= 0``.

Fill the second up to 1/2 by the end with least ``integral of u^2``. The first must be filled up over a time tau,
which costs ``1 / tau``; then what flows in flows over, and ``h' = u - h`` from 0 to H in ``s = T - tau`` costs ``2
H^2 / (1 - exp(-2 s))``.
"""

from __future__ import annotations

from math import exp

import numpy as np
import pyomo.environ as pyo
from scipy.optimize import minimize_scalar

import pyrobocop_pyomo as rcp

from .detection import MOVING, detect_switches
from .problem import NonsmoothProblem, at_boundaries, element_controls

HORIZON, LEVEL = 2.0, 0.5


def build(
    elements: int = 50, stages: int = 2, scheme: str = "radau", *, moving: bool = False, detect: bool = False
) -> pyo.ConcreteModel:
    """The first tank holds a volume of one."""
    m = pyo.ConcreteModel(name="overflow")
    m.phase = b = rcp.PhaseBlock(
        duration=HORIZON,
        elements=elements,
        stages=stages,
        scheme=scheme,
        free_element_widths=MOVING if moving or detect else None,
    )
    b.g = rcp.State(initial=0, initial_guess=0.5)
    b.h = rcp.State(initial=0, final=LEVEL, initial_guess=lambda t: LEVEL * t / HORIZON)
    b.u = rcp.Control(bounds=(0, 5), parametrization="piecewise_constant")
    b.over = rcp.Algebraic(bounds=(0, None))
    b.ode(lambda b, t: {b.g: b.u[t] - b.over[t], b.h: b.over[t] - b.h[t]})

    @b.complementarity
    def rim(b, t):
        return rcp.complements(1 - b.g[t] >= 0, b.over[t] >= 0)

    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    if detect:
        detect_switches(m)
    return m


def optimum() -> float:
    """The best time to run over, by a search over one number."""

    def cost(tau: float) -> float:
        return 1 / tau + 2 * LEVEL**2 / (1 - exp(-2 * (HORIZON - tau)))

    return float(minimize_scalar(cost, bounds=(0.1, HORIZON - 0.1), method="bounded", options={"xatol": 1e-10}).fun)


def deviation(m: pyo.ConcreteModel) -> float:
    """From the motion under the plan's own control, which is known in closed form on both sides of the overflow."""
    trajectory = m.phase.trajectory()
    g, h = 0.0, 0.0
    states = [(g, h)]
    for width, u in zip(np.diff(trajectory.grid.mesh.boundaries), element_controls(trajectory, "u"), strict=True):
        filling = min(width, (1 - g) / u) if u > 0 else width
        g, h = g + u * filling, h * exp(-filling)
        over = width - filling
        h = u + (h - u) * exp(-over)
        states.append((g, h if over > 0 else states[-1][1] * exp(-width)))
    return float(np.abs(at_boundaries(trajectory, "g", "h") - np.array(states)).max())


PROBLEM = NonsmoothProblem("overflow", build, deviation, optimum, accuracy=(0.03, 0.06))
