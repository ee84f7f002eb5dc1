"""Errors are estimated for rules that compute with the time as a number or read earlier times, and along a table."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.casadi


def driven(cosine: Any) -> Any:
    """A cart that is pushed by a force over time, below a ceiling over time."""
    m = pyo.ConcreteModel("driven")
    m.p = b = rcp.PhaseBlock(duration=2.0, elements=4, stages=2)
    b.x, b.v = rcp.State(initial=0, final=1), rcp.State(initial=0)
    b.u = rcp.Control(initial_guess=1.0)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] + cosine(3 * t) - b.x[t] ** 2})
    b.constraint(lambda b, t: b.u[t] <= 1 + cosine(t))
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 * (2 + cosine(t))))
    return m


def test_a_rule_of_numbers_has_the_errors_of_the_same_rule_in_symbols() -> None:
    found = []
    for cosine in (pyo.cos, math.cos):
        m = driven(cosine)
        result = rcp.solve(m)
        assert result.solved
        assert not result.discretisation.remarks
        found.append(result.discretisation)
    in_symbols, in_numbers = found
    assert in_numbers.objective_error == pytest.approx(in_symbols.objective_error, rel=1e-6)
    assert in_numbers.motion_error == pytest.approx(in_symbols.motion_error, abs=1e-3)


def test_conditions_on_the_time_are_followed() -> None:
    def build(elements: int) -> Any:
        m = pyo.ConcreteModel("two pushes")
        m.p = b = rcp.PhaseBlock(duration=2.0, elements=elements)
        b.x, b.u = rcp.State(initial=0, final=1), rcp.Control()
        b.ode(lambda b, t: {b.x: b.u[t] * (1 + min(1.0, t)) if t < 1.5 else b.u[t] + np.interp(t, [0, 2], [0, 1])})
        b.constraint(lambda b, t: b.u[t] >= -1 if t < 0.5 else pyo.Constraint.Skip)
        m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 + b.x[t] ** 2))
        return m

    coarse, fine = build(4), build(32)
    result, exact = (rcp.solve(m, mesh_tolerance=None) for m in (coarse, fine))
    assert result.solved
    assert exact.solved
    assert not result.discretisation.remarks
    error = abs(result.objective - exact.objective)
    assert error / 10 <= result.discretisation.objective_error <= 10 * error + 1e-6


def test_a_motion_at_the_edge_of_a_table_is_judged() -> None:
    heights = np.linspace(0.0, 2.0, 9)
    drag = rcp.Table(heights, 0.3 + np.exp(-heights), name="drag")
    m = pyo.ConcreteModel("down to the ground")
    m.p = b = rcp.PhaseBlock(duration=1.0, elements=6, scheme="implicit_euler")
    b.h, b.v = rcp.State(initial=1, final=0, bounds=(0, 2)), rcp.State(initial=-2, final=0)
    b.u = rcp.Control()
    b.ode(lambda b, t: {b.h: b.v[t], b.v: b.u[t] - drag(b.h[t]) * b.v[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    result = rcp.solve(m)
    assert result.solved
    # It slows down, so that a step of implicit Euler falls too little: the motion of the equations is below the ground.
    moved = b.reintegrate(b.trajectory())
    assert min(of["h"].min() for of in (moved.local, moved.open_loop)) < -0.01
    assert result.discretisation.motion_error is not None
    assert result.discretisation.objective_error is not None
    assert np.isfinite(b.trajectory().verify().element_error)
    with pytest.raises(rcp.errors.EvaluationError):
        drag(-0.01)


def delayed(elements: int, *, control: bool = False) -> Any:
    """A state that what it was half a second ago drives away."""
    m = pyo.ConcreteModel("delayed")
    m.p = b = rcp.PhaseBlock(duration=2.0, elements=elements, stages=2)
    b.x, b.u = rcp.State(initial=1, history=lambda t: 1 + t), rcp.Control(history=0.0)
    b.ode(lambda b, t: {b.x: 2 * b.x.delayed(t, 0.5) ** 2 + (b.u.delayed(t, 0.5) if control else b.u[t])})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2))
    return m


def test_delayed_states_have_errors() -> None:
    exact = rcp.solve(delayed(64)).objective
    for elements in (4, 8):
        result = rcp.solve(delayed(elements))
        assert result.solved
        assert not result.discretisation.remarks
        error = abs(result.objective - exact)
        assert error / 10 <= result.discretisation.objective_error <= 10 * error
        assert result.discretisation.motion_error < (0.2, 0.02)[elements == 8]


def test_what_a_delayed_control_does_later_is_not_claimed_to_be_known() -> None:
    found = rcp.solve(delayed(8, control=True)).discretisation
    assert found.objective_error is None
    assert "'u' is read at earlier times" in " ".join(found.remarks)
    assert found.motion_error is not None
