"""A car whose turbo charger multiplies its acceleration by three above a speed: from rest to rest in minimal time.

Nurkanović, Sperl, Albrecht & Diehl, Finite Elements with Switch Detection for direct optimal control of nonsmooth
systems, Numer. Math. 156 (2024), doi:10.1007/s00211-024-01412-z, treat such switched dynamics.
"""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .detection import MOVING, detect_switches
from .filippov import Filippov
from .problem import NonsmoothProblem, at_boundaries, element_controls
from .switches import add_step

DISTANCE, FASTEST, THRESHOLD, PLAIN, FACTOR = 200.0, 25.0, 15.0, 5.0, 3.0


def build(
    elements: int = 50, stages: int = 2, scheme: str = "radau", *, moving: bool = False, detect: bool = False
) -> pyo.ConcreteModel:
    """Speeds in units of 10 m/s, distances in units of 100 m, so that all numbers are about one."""
    m = pyo.ConcreteModel(name="turbo car")
    duration = rcp.Duration(bounds=(1, 40), initial_guess=15)
    m.phase = b = rcp.PhaseBlock(
        duration=duration,
        elements=elements,
        stages=stages,
        scheme=scheme,
        free_element_widths=MOVING if moving or detect else None,
    )
    b.x = rcp.State(initial=0, final=DISTANCE / 100, initial_guess=lambda t: DISTANCE / 100 * t)
    b.v = rcp.State(initial=0, final=0, bounds=(0, FASTEST / 10), initial_guess=1)
    b.u = rcp.Control(bounds=(-1, 1), parametrization="piecewise_constant")  # of the plain acceleration
    add_step(b, "turbo", lambda b, t: b.v[t] - THRESHOLD / 10)

    @b.ode
    def car(b, t):
        return {b.x: b.v[t] / 10, b.v: PLAIN / 10 * b.u[t] * (1 + (FACTOR - 1) * b.turbo[t])}

    m.time = pyo.Objective(expr=b.duration)
    if detect:
        detect_switches(m)
    return m


def optimum() -> float:
    """Accelerate as strongly as the speed allows, drive at the highest, brake in the same way."""
    with_turbo = PLAIN * FACTOR
    seconds = THRESHOLD / PLAIN + (FASTEST - THRESHOLD) / with_turbo
    metres = THRESHOLD**2 / (2 * PLAIN) + (FASTEST**2 - THRESHOLD**2) / (2 * with_turbo)
    return 2 * seconds + (DISTANCE - 2 * metres) / FASTEST


SYSTEM = Filippov(
    rates=lambda x, u, w: np.array([x[1] / 10, PLAIN / 10 * u * (1 + (FACTOR - 1) * w)]),
    surface=lambda x: x[1] - THRESHOLD / 10,
    gradient=lambda x: np.array([0.0, 1.0]),
)


def deviation(m: pyo.ConcreteModel) -> float:
    """From the motion under the plan's own control."""
    trajectory = m.phase.trajectory()
    states = at_boundaries(trajectory, "x", "v")
    true = SYSTEM.simulate(trajectory.grid.mesh.boundaries, element_controls(trajectory, "u"), states[0])
    return float(np.abs(states - true).max())


PROBLEM = NonsmoothProblem("turbo car", build, deviation, optimum, accuracy=(0.02, 0.3))
