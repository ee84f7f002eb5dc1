"""A disc makes its way between two others that lie symmetrically, on a viscous floor.

The pusher's force is the control, ``p' = u - f_1 (q_1 - p) - f_2 (q_2 - p)``; a pushed disc moves as ``q_i' = f_i
(q_i - p)``, with ``0 <= f_i ⟂ |q_i - p|^2 - 1 >= 0`` for discs of diameter one. Least ``integral of |u|^2`` from one
side to the other. The problem is symmetric, and a symmetric initial guess has a symmetric answer.
"""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .detection import MOVING, detect_switches
from .problem import NonsmoothProblem, at_boundaries, element_controls
from .switches import add_pair

HORIZON, REACH, ASIDE = 4.0, 1.5, 0.6


def build(
    elements: int = 50, stages: int = 2, scheme: str = "radau", *, moving: bool = False, detect: bool = False
) -> pyo.ConcreteModel:
    """From (-REACH, 0) to (REACH, 0), past discs at (0, ASIDE) and (0, -ASIDE)."""
    m = pyo.ConcreteModel(name="discs")
    m.phase = b = rcp.PhaseBlock(
        duration=HORIZON,
        elements=elements,
        stages=stages,
        scheme=scheme,
        free_element_widths=MOVING if moving or detect else None,
    )
    b.x = rcp.State(initial=-REACH, final=REACH, initial_guess=lambda t: REACH * (2 * t / HORIZON - 1))
    b.y = rcp.State(initial=0, final=0)
    for i, side in ((1, 1.0), (2, -1.0)):
        b.declare(f"x_{i}", rcp.State(initial=0))
        b.declare(
            f"y_{i}",
            rcp.State(initial=side * ASIDE, initial_guess=lambda t, side=side: side * (ASIDE + 0.4 * t / HORIZON)),
        )
        b.declare(f"force_{i}", rcp.Algebraic(bounds=(0, None)))
    b.u_x = rcp.Control(bounds=(-10, 10), parametrization="piecewise_constant", initial_guess=0.5)
    b.u_y = rcp.Control(bounds=(-10, 10), parametrization="piecewise_constant")

    def offset(b, t, i):
        return getattr(b, f"x_{i}")[t] - b.x[t], getattr(b, f"y_{i}")[t] - b.y[t]

    @b.ode
    def viscous(b, t):
        rates = {b.x: b.u_x[t], b.y: b.u_y[t]}
        for i in (1, 2):
            push_x, push_y = (getattr(b, f"force_{i}")[t] * component for component in offset(b, t, i))
            rates[getattr(b, f"x_{i}")], rates[getattr(b, f"y_{i}")] = push_x, push_y
            rates[b.x], rates[b.y] = rates[b.x] - push_x, rates[b.y] - push_y
        return rates

    for i in (1, 2):
        add_pair(
            b,
            f"contact_{i}",
            lambda b, t, i=i: sum(component**2 for component in offset(b, t, i)) - 1,
            lambda b, t, i=i: getattr(b, f"force_{i}")[t],
        )

    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u_x[t] ** 2 + b.u_y[t] ** 2))
    if detect:
        detect_switches(m)
    return m


def catch_up(boundaries, controls: np.ndarray, steps: int = 100) -> np.ndarray:
    """Moreau's catching-up: small free steps, each projected out of the overlaps, shape ``(N + 1, 6)``."""
    p, q = np.array([-REACH, 0.0]), np.array([[0.0, ASIDE], [0.0, -ASIDE]])
    states = [np.concatenate([p, *q])]
    for width, u in zip(np.diff(boundaries), controls, strict=True):
        for _ in range(steps):
            p = p + width / steps * u
            for _ in range(
                50
            ):  # both discs of an overlap give way by half; two contacts disturb each other, hence repeat
                offsets = q - p
                distances = np.linalg.norm(offsets, axis=1)
                overlaps = np.maximum(1 - distances, 0)
                if overlaps.max() < 1e-13:
                    break
                shifts = (overlaps / distances / 2)[:, None] * offsets
                q, p = q + shifts, p - shifts.sum(axis=0)
        states.append(np.concatenate([p, *q]))
    return np.array(states)


def deviation(m: pyo.ConcreteModel) -> float:
    """From catching up under the plan's own control."""
    trajectory = m.phase.trajectory()
    controls = np.column_stack([element_controls(trajectory, "u_x"), element_controls(trajectory, "u_y")])
    true = catch_up(trajectory.grid.mesh.boundaries, controls)
    states = at_boundaries(trajectory, "x", "y", "x_1", "y_1", "x_2", "y_2")
    return float(np.abs(states - true).max())


PROBLEM = NonsmoothProblem("discs", build, deviation, optimum=None, accuracy=(0.0, 0.1))
