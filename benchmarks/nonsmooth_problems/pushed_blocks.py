"""One block pushes another through a viscous fluid: ``x' = u - f``, ``y' = f``, with ``0 <= f ⟂ y - x - 1 >= 0``.

Min ``integral of u^2`` such that the second block, which nothing else can move, gets from 2 to 3; the first one
starts at 0. First it travels alone over the gap of one, then both travel together at half the speed per force: with
the time tau of contact the cost is ``1 / tau + 4 / (T - tau)``, least at ``tau = T / 3``, which gives ``9 / T``.
"""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .detection import MOVING, detect_switches
from .problem import NonsmoothProblem, at_boundaries, element_controls

HORIZON = 3.0


def build(
    elements: int = 50, stages: int = 2, scheme: str = "radau", *, moving: bool = False, detect: bool = False
) -> pyo.ConcreteModel:
    """The contact force exists only where there is no gap."""
    m = pyo.ConcreteModel(name="pushed blocks")
    m.phase = b = rcp.PhaseBlock(
        duration=HORIZON,
        elements=elements,
        stages=stages,
        scheme=scheme,
        free_element_widths=MOVING if moving or detect else None,
    )
    b.x = rcp.State(initial=0, initial_guess=lambda t: 2 * t / HORIZON)
    b.y = rcp.State(initial=2, final=3, initial_guess=lambda t: 2 + t / HORIZON)
    b.u = rcp.Control(bounds=(-5, 5), parametrization="piecewise_constant")
    b.force = rcp.Algebraic(bounds=(0, None))
    b.ode(lambda b, t: {b.x: b.u[t] - b.force[t], b.y: b.force[t]})

    @b.complementarity
    def push(b, t):
        return rcp.complements(b.y[t] - b.x[t] - 1 >= 0, b.force[t] >= 0)

    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    if detect:
        detect_switches(m)
    return m


def optimum() -> float:
    """In closed form; see above."""
    return 9 / HORIZON


def deviation(m: pyo.ConcreteModel) -> float:
    """From the motion under the plan's own control: free, or together, with the time of contact in closed form."""
    trajectory = m.phase.trajectory()
    x, y = 0.0, 2.0
    states = [(x, y)]
    for width, u in zip(np.diff(trajectory.grid.mesh.boundaries), element_controls(trajectory, "u"), strict=True):
        alone = width if u <= 0 else min(width, (y - 1 - x) / u)
        x += u * alone
        x, y = x + u / 2 * (width - alone), y + u / 2 * (width - alone)
        states.append((x, y))
    return float(np.abs(at_boundaries(trajectory, "x", "y") - np.array(states)).max())


PROBLEM = NonsmoothProblem("pushed blocks", build, deviation, optimum, accuracy=(0.03, 0.06))
