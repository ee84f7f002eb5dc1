"""A hop straight up: body and foot with an actuator between them, and a floor that can only push.

``v_b' = u - g``, ``m v_f' = n - u - m g`` with ``0 <= n ⟂ y_f >= 0``; at the end the body is at a height and the foot
drawn up under it. Least ``integral of u^2``. Nothing says when the foot leaves the floor; the reference optimises
that instant between two smooth phases.
"""

from __future__ import annotations

from functools import cache
from math import sqrt

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .detection import MOVING, detect_switches
from .problem import NonsmoothProblem, at_boundaries, element_controls

HORIZON, START, GOAL, FOOT_GOAL, FOOT_MASS, GRAVITY, LONGEST = 0.8, 0.5, 1.2, 0.5, 0.25, 10.0, 0.9


def build(
    elements: int = 50, stages: int = 1, scheme: str = "radau", *, moving: bool = False, detect: bool = False
) -> pyo.ConcreteModel:
    """Forces per mass of the body and per 10 m/s^2, so that standing takes a force of one."""
    m = pyo.ConcreteModel(name="hop")
    m.phase = b = rcp.PhaseBlock(
        duration=HORIZON,
        elements=elements,
        stages=stages,
        scheme=scheme,
        free_element_widths=MOVING if moving or detect else None,
    )
    b.y_b = rcp.State(initial=START, final=GOAL, initial_guess=lambda t: START + (GOAL - START) * t / HORIZON)
    b.v_b = rcp.State(initial=0)
    b.y_f = rcp.State(initial=0, final=FOOT_GOAL, initial_guess=lambda t: max(0.0, t - 0.3))
    b.v_f = rcp.State(initial=0)
    b.u = rcp.Control(bounds=(-10, 10), parametrization="piecewise_constant", initial_guess=1)
    b.floor = rcp.Algebraic(bounds=(0, None), initial_guess=1)

    @b.ode
    def newton(b, t):
        foot = (b.floor[t] - b.u[t]) / FOOT_MASS - 1
        return {b.y_b: b.v_b[t], b.v_b: GRAVITY * (b.u[t] - 1), b.y_f: b.v_f[t], b.v_f: GRAVITY * foot}

    @b.complementarity
    def floor_pushes(b, t):
        return rcp.complements(b.y_f[t] >= 0, b.floor[t] >= 0)

    @b.constraint
    def leg(b, t):
        return b.y_b[t] - b.y_f[t] <= LONGEST

    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    if detect:
        detect_switches(m)
    return m


@cache
def optimum() -> float:
    """Stance and flight as two smooth phases of free duration: no complementarity, high order."""
    m = pyo.ConcreteModel(name="hop in two phases")
    free = rcp.Duration(bounds=(0.05, HORIZON), initial_guess=HORIZON / 2)
    m.stance = rcp.PhaseBlock(duration=free, elements=20)
    m.flight = rcp.PhaseBlock(duration=free, elements=20)
    for b, final in ((m.stance, None), (m.flight, GOAL)):
        b.y_b = rcp.State(initial=START if b is m.stance else None, final=final, initial_guess=0.8)
        b.v_b = rcp.State(initial=0 if b is m.stance else None, initial_guess=1)
        b.u = rcp.Control(bounds=(-10, 10), initial_guess=1)
    s, f = m.stance, m.flight
    f.y_f = rcp.State(initial=0, final=FOOT_GOAL, initial_guess=0.2)
    f.v_f = rcp.State(initial=0, initial_guess=1)
    s.ode(lambda b, t: {b.y_b: b.v_b[t], b.v_b: GRAVITY * (b.u[t] - 1)})
    f.ode(
        lambda b, t: {
            b.y_b: b.v_b[t], b.v_b: GRAVITY * (b.u[t] - 1),
            b.y_f: b.v_f[t], b.v_f: GRAVITY * (-b.u[t] / FOOT_MASS - 1),
        }
    )  # fmt: skip

    @s.constraint
    def standing(b, t):
        return [b.y_b[t] <= LONGEST, b.u[t] >= -FOOT_MASS]

    @f.constraint
    def flying(b, t):
        return [b.y_b[t] - b.y_f[t] <= LONGEST, b.y_f[t] >= 0]

    m.lift_off = rcp.Link(s, f, omit=["y_f", "v_f"])
    m.whole = pyo.Constraint(expr=s.duration + f.duration == HORIZON)
    m.effort = pyo.Objective(expr=sum(b.integral(lambda b, t: b.u[t] ** 2) for b in (s, f)))
    rcp.solve(m, progress=False).raise_for_status()
    return float(pyo.value(m.effort))


def deviation(m: pyo.ConcreteModel) -> float:
    """From the motion under the plan's own control: parabolas between lift-off and touch-down, without rebound."""
    trajectory = m.phase.trajectory()
    body, foot = np.array([START, 0.0]), np.array([0.0, 0.0])
    states = [(body[0], foot[0])]
    for width, u in zip(np.diff(trajectory.grid.mesh.boundaries), element_controls(trajectory, "u"), strict=True):
        body = _fall(body, GRAVITY * (u - 1), width)
        foot = _foot(foot, GRAVITY * (-u / FOOT_MASS - 1), width)
        states.append((body[0], foot[0]))
    return float(np.abs(at_boundaries(trajectory, "y_b", "y_f") - np.array(states)).max())


def _fall(state: np.ndarray, acceleration: float, time: float) -> np.ndarray:
    y, v = state
    return np.array([y + v * time + 0.5 * acceleration * time**2, v + acceleration * time])


def _foot(state: np.ndarray, acceleration: float, time: float) -> np.ndarray:
    y, v = state
    if y <= 0 and v <= 0 and acceleration <= 0:
        return np.zeros(2)
    landed = _fall(state, acceleration, time)
    # Without rebound, and with a constant acceleration: a foot that lands within the step stays.
    if landed[0] <= 0 and acceleration < 0 and (v + sqrt(v**2 - 2 * acceleration * y)) / -acceleration <= time:
        return np.zeros(2)
    return landed


PROBLEM = NonsmoothProblem("hop", build, deviation, optimum, accuracy=(0.1, 0.1))
