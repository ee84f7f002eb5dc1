"""Elements in which an explicit method is held back by stability are integrated by an implicit one."""

from __future__ import annotations

from math import cos, exp, sin

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp

RATE = 10000.0


def test_the_error_of_a_stiff_element_is_that_of_the_exact_motion() -> None:
    m = pyo.ConcreteModel("stiff")
    m.p = b = rcp.PhaseBlock(duration=1.0, elements=1)
    b.x = rcp.State(initial=0)
    calls = 0

    def rates(b, t):
        nonlocal calls
        calls += 1
        return {b.x: -RATE * (b.x[t] - pyo.cos(t))}

    b.ode(rates)
    planned = {t: cos(t) + 0.01 * sin(3 * t) for t in b.time}
    for t, variable in b.x.items():
        variable.set_value(planned[t], skip_validation=True)
    b.x[0.0].set_value(1.0)

    def steady(t: float) -> float:
        return RATE * (RATE * cos(t) + sin(t)) / (RATE**2 + 1)

    exact = steady(1.0) + (1.0 - steady(0.0)) * exp(-RATE)
    calls = 0
    (error,) = b.element_errors(b.trajectory())
    assert error == pytest.approx(abs(planned[1.0] - exact), rel=1e-6)
    assert calls < 15_000  # an explicit method takes two calls and more for each unit of RATE times the duration
