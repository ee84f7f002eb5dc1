"""What a newcomer writes first and gets wrong: the message names the place and what to write instead; that works."""

from __future__ import annotations

import pyomo.environ as pyo
import pytest
from mistakes.entries import cart, driven, newton
from pyomo.core.expr.visitor import identify_variables
from pyomo.environ import units as u

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError


def test_a_boundary_is_found_by_its_number_whatever_its_rounding():
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=2.4, elements=24)
    b.x, b.v = rcp.State(), rcp.State(index=2)
    for number in range(25):
        time = number / 10  # the boundary at 0.8 is 0.7999999999999999
        assert b.x[time].index() in b.time
        assert abs(b.v[1, time].index() - time) < 1e-12
    with pytest.raises(KeyError, match="no value of its own"):
        b.x[0.8 + 1e-9]


@pytest.mark.ipopt
def test_a_variable_of_the_user_is_the_duration():
    m = pyo.ConcreteModel()
    m.T = pyo.Var(bounds=(0.5, 5), initialize=2)
    b = cart(m, duration=m.T)
    b.ode(newton)
    m.soon = pyo.Objective(expr=m.T)
    of_declaration = pyo.ConcreteModel()
    c = cart(of_declaration, duration=rcp.Duration(bounds=(0.5, 5), initial_guess=2))
    c.ode(newton)
    of_declaration.soon = pyo.Objective(expr=c.duration)
    assert rcp.solve(m).solved
    assert rcp.solve(of_declaration).solved
    assert m.T.value == pytest.approx(c.duration.value, rel=1e-7)
    assert b.duration.value == pytest.approx(m.T.value, rel=1e-9)
    copy = m.clone()
    assert {id(data) for data in identify_variables(copy.p.duration_as_stated.body)} == {
        id(copy.T),
        id(copy.p.duration),
    }


@pytest.mark.ipopt
def test_a_param_of_the_user_is_the_duration_also_after_it_has_changed():
    m = pyo.ConcreteModel()
    m.T = pyo.Param(initialize=2.0, mutable=True)
    driven(m, duration=m.T)
    for duration in (2.0, 3.0):
        m.T.set_value(duration)
        assert rcp.solve(m).solved
        # x(t) is the cubic of least effort: 12 (distance)^2 / T^3.
        assert pyo.value(m.effort) == pytest.approx(12.0 / duration**3, rel=1e-6)


@pytest.mark.parametrize(
    "make", [lambda m: pyo.Var(bounds=(-1, 1)), lambda m: pyo.Param(initialize=-2.0, mutable=True), lambda m: pyo.Var()]
)
def test_a_duration_that_may_be_negative_is_refused_by_name(make):
    m = pyo.ConcreteModel()
    m.T = make(m)
    with pytest.raises(ModelError, match=r"the duration 'T' has the value .*must be one positive number"):
        cart(m, duration=m.T)


@pytest.mark.ipopt
def test_units_that_differ_are_refused_before_the_solve():
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=2.0, elements=4, time_units=u.s)
    b.x = rcp.State(initial=0, final=1, units=u.m)
    b.v = rcp.State(initial=0, units=u.m / u.s)
    b.u = rcp.Control(bounds=(-2, 2), units=u.N)
    b.ode(newton)
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    with pytest.raises(ModelError, match="'p.v_collocation'.*not compatible.*correct the units"):
        rcp.solve(m)
