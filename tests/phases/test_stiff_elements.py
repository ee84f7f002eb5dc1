"""Elements in which an explicit method is held back by stability are integrated by an implicit one."""

from __future__ import annotations

from math import cos, exp, sin
from typing import Any

import pyomo.environ as pyo
import pytest
from scipy.integrate import solve_ivp

import pyrobocop_pyomo as rcp

RATE = 10000.0


def test_the_error_of_a_stiff_element_is_that_of_the_exact_motion() -> None:
    m = pyo.ConcreteModel("stiff")
    m.p = b = rcp.PhaseBlock(duration=1.0, elements=1)
    b.x = rcp.State(initial=0)
    b.ode(lambda b, t: {b.x: -RATE * (b.x[t] - pyo.cos(t))})
    planned = {t: cos(t) + 0.01 * sin(3 * t) for t in b.time}
    for t, variable in b.x.items():
        variable.set_value(planned[t], skip_validation=True)
    b.x[0.0].set_value(1.0)

    def steady(t: float) -> float:
        return RATE * (RATE * cos(t) + sin(t)) / (RATE**2 + 1)

    exact = steady(1.0) + (1.0 - steady(0.0)) * exp(-RATE)
    (error,) = b.element_errors(b.trajectory())
    assert error == pytest.approx(abs(planned[1.0] - exact), rel=1e-6)


def test_the_reactions_of_robertson_agree_with_scipy() -> None:
    def rates(y: Any) -> list[Any]:
        slow, fast, square = 0.04 * y[0], 1e4 * y[1] * y[2], 3e7 * y[1] ** 2
        return [-slow + fast, slow - fast - square, square]

    m = pyo.ConcreteModel("reactions")
    m.p = b = rcp.PhaseBlock(duration=80.0, elements=4)
    b.slow, b.fast, b.last = rcp.State(initial=1.0), rcp.State(initial=0.0), rcp.State(initial=0.0)
    states = [b.slow, b.fast, b.last]
    b.ode(lambda b, t: dict(zip(states, rates([state[t] for state in states]), strict=True)))
    b.initialize(slow=0.9, fast=3e-5, last=0.1)
    exact = solve_ivp(lambda t, y: rates(y), (0, 80.0), [1.0, 0.0, 0.0], method="Radau", rtol=1e-10, atol=1e-13)
    found = b.reintegrate().open_loop
    for values, expected, size in zip(found.values(), exact.y[:, -1], [1.0, 1e-3, 1.0], strict=True):
        assert values[-1, -1] == pytest.approx(expected, abs=1e-6 * size)


@pytest.mark.casadi
def test_the_error_of_a_stiff_motion_is_known() -> None:
    m = pyo.ConcreteModel(name="relaxation")
    m.go = b = rcp.PhaseBlock(duration=2.0, elements=4, stages=2)
    b.x, b.clock = rcp.State(initial=1.0), rcp.State(initial=0.0)
    b.ode(lambda b, t: {b.x: -1e6 * (b.x[t] - pyo.cos(b.clock[t])), b.clock: 1.0})
    m.nothing = pyo.Objective(expr=0.0)
    result = rcp.solve(m, backend="casadi")
    assert result.solved
    assert b.trajectory().verify().element_error < 1e-4
