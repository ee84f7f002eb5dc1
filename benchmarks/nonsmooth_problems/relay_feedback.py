"""The best gain of a relay controller.

``x'' = -sign(x + c x')`` from x = 1 at rest; min ``integral of x^2 + x'^2`` over c.

A small gain lets the motion cross the surface again and again, a large one makes it slide slowly along ``x = -c x'``.
The reference minimises the same cost over simulations that locate each switch.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pyomo.environ as pyo
from scipy.optimize import minimize_scalar

import pyrobocop_pyomo as rcp

from .detection import MOVING, detect_switches
from .filippov import Filippov
from .problem import NonsmoothProblem, at_boundaries
from .switches import add_step

HORIZON, GAINS = 4.0, (0.2, 3.0)


def build(
    elements: int = 50, stages: int = 2, scheme: str = "radau", *, moving: bool = False, detect: bool = False
) -> pyo.ConcreteModel:
    """The gain is the only thing to choose."""
    m = pyo.ConcreteModel(name="relay feedback")
    m.phase = b = rcp.PhaseBlock(
        duration=HORIZON,
        elements=elements,
        stages=stages,
        scheme=scheme,
        free_element_widths=MOVING if moving or detect else None,
    )
    b.x = rcp.State(initial=1, initial_guess=lambda t: np.exp(-t))
    b.v = rcp.State(initial=0, initial_guess=lambda t: -np.exp(-t))
    b.gain = rcp.Parameter(bounds=GAINS, initial_guess=1)
    add_step(b, "push", lambda b, t: b.x[t] + b.gain * b.v[t])
    b.ode(lambda b, t: {b.x: b.v[t], b.v: 1 - 2 * b.push[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.v[t] ** 2))
    if detect:
        detect_switches(m)
    return m


def simulate(gain: float, boundaries) -> np.ndarray:
    """Position, speed and cost so far, shape ``(N + 1, 3)``."""
    system = Filippov(
        rates=lambda x, u, w: np.array([x[1], 1 - 2 * w, x[0] ** 2 + x[1] ** 2]),
        surface=lambda x: x[0] + gain * x[1],
        gradient=lambda x: np.array([1.0, gain, 0.0]),
    )
    return system.simulate(boundaries, [0.0] * (len(boundaries) - 1), [1.0, 0.0, 0.0])


@cache
def optimum() -> float:
    """The best of all gains; a scan first, since crossing and sliding may each have their own minimum."""

    def cost(gain: float) -> float:
        return float(simulate(gain, [0.0, HORIZON])[-1, 2])

    scanned = np.linspace(*GAINS, 29)
    best = scanned[np.argmin([cost(gain) for gain in scanned])]
    return float(minimize_scalar(cost, bounds=(best - 0.1, best + 0.1), method="bounded", options={"xatol": 1e-7}).fun)


def deviation(m: pyo.ConcreteModel) -> float:
    """From the motion with the plan's own gain."""
    trajectory = m.phase.trajectory()
    true = simulate(float(trajectory.gain), trajectory.grid.mesh.boundaries)
    return float(np.abs(at_boundaries(trajectory, "x", "v") - true[:, :2]).max())


PROBLEM = NonsmoothProblem("relay feedback", build, deviation, optimum, accuracy=(0.03, 0.1))
