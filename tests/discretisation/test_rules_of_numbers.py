"""Errors are not known of rules that compute with the time as a number; of earlier times and tables they are."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.casadi


# What was asked at the points of the mesh while it was built: 0 or another problem is seen between them.
BY_POINT: dict[str, Any] = {
    "a function of Python": (lambda b, t: math.cos(3 * t), {}),
    "a pulse": (lambda b, t: 40.0 if 0.4 < t < 0.41 else 0.0, {}),
    "a dictionary": (lambda b, t: {0.0: 1.0}.get(t, 0.0), {}),
    "samples": (lambda b, t: float(np.interp(t, [0, 2], [0, 1])), {}),
    "bounds that jump": (lambda b, t: 0.0, {"bounds": lambda t: (-9, 1.0 if t < 0.37 else 2.0)}),
}


def driven(rate: Any, control: Any) -> Any:
    m = pyo.ConcreteModel("driven")
    m.p = b = rcp.PhaseBlock(duration=2.0, elements=4, stages=2)
    b.x, b.u = rcp.State(initial=0, final=1), rcp.Control(**control)
    b.ode(lambda b, t: {b.x: b.u[t] + rate(b, t)}, name="drive")
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m


@pytest.mark.parametrize("name", BY_POINT)
def test_errors_are_not_known_where_a_rule_has_to_know_the_time(name: str) -> None:
    m = driven(*BY_POINT[name])
    result = rcp.solve(m)
    assert result.solved
    found = result.discretisation
    assert (found.objective_error, found.motion_error, found.excess) == (None, None, None)
    (why,) = found.remarks
    assert "bounds of 'u'" in why if name == "bounds that jump" else "ode 'drive' (test_rules_of_numbers.py:" in why
    assert m.p.grid.mesh.elements == 4


def test_a_window_of_rows_has_errors_that_are_not_known() -> None:
    m = driven(lambda b, t: 0.0, {})
    m.p.constraint(lambda b, t: b.u[t] <= 0.2 if 0.7 < t < 1.1 else pyo.Constraint.Skip, name="window")
    found = rcp.solve(m).discretisation
    assert found.objective_error is None
    assert "'window'" in found.remarks[0]


def test_in_symbols_the_same_statements_have_small_errors_and_boundaries_where_they_jump() -> None:
    m = driven(lambda b, t: pyo.Expr_if(pyo.inequality(0.4, t, 0.41), 40.0, 0.0) + pyo.cos(3 * t), {})
    m.p.y = rcp.Algebraic(bounds=lambda t: (-9, pyo.Expr_if(t < 1.37, 1.0, 2.0)))
    m.p.residual(lambda b, t: b.y[t] == b.x[t] / 9)
    result = rcp.solve(m)
    assert result.discretisation.relative_objective_error < 1e-3
    for time in (0.4, 0.41, 1.37):
        assert min(abs(time - boundary) for boundary in m.p.grid.mesh.boundaries) < 1e-9
    # The least effort is constant: x(2) = 1 less what the drive gives.
    assert result.objective == pytest.approx((1 - 0.4 - math.sin(6) / 3) ** 2 / 2, rel=1e-3)


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
