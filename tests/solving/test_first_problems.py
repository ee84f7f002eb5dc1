"""Problems as somebody states them who has just read the documentation."""

from __future__ import annotations

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.casadi


def test_batch_reactor_with_a_limit_on_the_heat():
    """A -> B -> C: the yield of B is 0.6108 without the limit, and less with it; the limit is met and is active."""
    m = pyo.ConcreteModel(name="batch reactor")
    m.run = b = rcp.PhaseBlock(duration=1.0, elements=8)
    b.a, b.b = rcp.State(initial=1, bounds=(0, 1)), rcp.State(initial=0, bounds=(0, 1))
    b.temperature = rcp.Control(bounds=(298, 398), initial_guess=340, parametrization="piecewise_linear")

    def first_rate(b, t):
        return 4000 * pyo.exp(-2500 / b.temperature[t]) * b.a[t] ** 2

    @b.ode
    def kinetics(b, t):
        second = 620000 * pyo.exp(-5000 / b.temperature[t]) * b.b[t]
        return {b.a: -first_rate(b, t), b.b: first_rate(b, t) - second}

    @b.constraint
    def heat(b, t):
        return first_rate(b, t) <= 1.5

    m.product = pyo.Objective(expr=b.b[b.time.last()], sense=pyo.maximize)
    result = rcp.solve(m, progress=False)
    result.raise_for_status()
    assert 0.59 < result.objective < 0.6107
    assert max(pyo.value(row.body) for row in b.heat.values()) == pytest.approx(1.5, abs=1e-6)


def test_mass_that_falls_and_is_thrown_back():
    """The floor gives back 0.8 of the speed; the rest that it takes to rise as high again is 0.2 sqrt(2 g h)."""
    m = pyo.ConcreteModel(name="thrown back")
    m.fall = a = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 2)), elements=2)
    a.height, a.speed = rcp.State(initial=1, final=0), rcp.State(initial=0)
    m.rise = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 2)), elements=2)
    b.height, b.speed = rcp.State(initial=0, final=1), rcp.State(final=0)
    b.push = rcp.Parameter(bounds=(0, 10))
    for phase in (a, b):
        phase.ode(lambda b, t: {b.height: b.speed[t], b.speed: -9.81})
    m.impact = rcp.Link(a, b, jump=lambda pre, post: {"speed": -0.8 * pre.speed + post.push})
    m.effort = pyo.Objective(expr=b.push**2)
    rcp.solve(m, progress=False).raise_for_status()
    assert b.push.value == pytest.approx(0.2 * (2 * 9.81) ** 0.5, abs=1e-6)
    assert b.duration.value == pytest.approx((2 / 9.81) ** 0.5, abs=1e-6)
