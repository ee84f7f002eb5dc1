"""Numbers of declarations as Pyomo's users write them: Params that change, expressions, and numbers with units."""

from typing import Any

import pyomo.environ as pyo
import pytest
from harness.phases import one_phase

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.phases.declarations import FunctionOfTime

metre = pyo.units.m


def cart(x0: Any = 0.0, final: Any = 1.0, units: Any = None, **of_x: Any) -> pyo.ConcreteModel:
    m, b = one_phase("go", model="cart", duration=1.0, elements=4)
    m.x0 = pyo.Param(initialize=0.5, mutable=True)
    m.goal = pyo.Param(initialize=2.0, mutable=True)
    read = lambda given: given(m) if callable(given) and not hasattr(given, "is_expression_type") else given  # noqa: E731
    b.x = rcp.State(initial=read(x0), final=read(final), units=units, **{k: read(v) for k, v in of_x.items()})
    b.v = rcp.Control(units=units)
    b.ode(lambda b, t: {b.x: b.v[t]})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.v[t] ** 2))
    return m


@pytest.mark.ipopt
def test_a_param_at_both_ends_is_followed_by_the_next_solve() -> None:
    m = cart(lambda m: m.x0, lambda m: 2 * m.goal + 1)
    for start, goal in ((0.5, 2.0), (-1.0, 3.0)):
        m.x0.set_value(start)
        m.goal.set_value(goal)
        result = rcp.solve(m)
        assert result.objective == pytest.approx((2 * goal + 1 - start) ** 2)
        assert (m.go.x.at_start.value, m.go.x.at_end.value) == pytest.approx((start, 2 * goal + 1))
        verdict = m.go.trajectory().verify()
        assert verdict.largest_violation < 1e-7
        assert not verdict.remarks
    plan = m.go.trajectory()
    m.x0.set_value(4.0)
    assert m.go.verify(plan).largest_violation == pytest.approx(5.0)


def test_without_a_guess_a_state_starts_from_a_param_as_from_a_number() -> None:
    assert {variable.value for variable in cart(lambda m: m.x0).go.x.values()} - {1.0} == {0.5}
    assert {variable.value for variable in cart(None, lambda m: 2 * m.goal).go.x.values()} == {4.0}
    both = cart(lambda m: m.x0, lambda m: m.goal).go.x
    assert {variable.value for variable in both.values()} == {0.5, 2.0}
    assert both.at_end.value == 2.0
    assert {variable.value for variable in cart((0, 1), (0, 1)).go.x.values()} == {0.0}


@pytest.mark.ipopt
def test_a_copy_follows_its_own_param_also_on_another_mesh() -> None:
    m = cart(lambda m: m.x0)
    copied = m.clone()
    copied.x0.set_value(-3.0)
    copied.go.remesh([0, 0.1, 0.4, 1])
    for model, start in ((m, 0.5), (copied, -3.0)):
        assert rcp.solve(model).objective == pytest.approx((1 - start) ** 2)
        assert model.go.trajectory().verify().largest_violation < 1e-7
        assert model.go.simulate({"v": 0.0}).states["x"][0] == start


@pytest.mark.ipopt
def test_the_start_may_be_a_variable_of_the_model() -> None:
    m, b = one_phase("go", duration=1.0, elements=2)
    m.free = pyo.Var()
    b.x, b.v = rcp.State(initial=m.free, final=1), rcp.Control()
    b.ode(lambda b, t: {b.x: b.v[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.v[t] ** 2) + m.free**2)
    assert rcp.solve(m).solved
    assert m.free.value == pytest.approx(0.5)


@pytest.mark.ipopt
def test_units_are_converted_to_those_of_the_declaration() -> None:
    centimetre = pyo.units.cm
    m = cart(300 * centimetre, 5.0, metre, bounds=(-200 * centimetre, None), initial_guess=400 * centimetre)
    assert m.go.x[0].fixed
    assert m.go.x[0].value == pytest.approx(3.0)
    assert m.go.x[0.25].value == pytest.approx(4.0)
    assert m.go.x[0.25].lb == pytest.approx(-2.0)
    m, b = one_phase("go", duration=1.0, elements=2, time_units=pyo.units.s)
    m.far = pyo.Param(initialize=300.0, mutable=True, units=centimetre)
    m.plain = pyo.Param(initialize=5.0, mutable=True)
    jerky = (None, 30 * centimetre / pyo.units.s**2)
    b.x = rcp.State(initial=m.far, final=m.plain, units=metre)
    b.v = rcp.Control(units=metre / pyo.units.s, rate_bounds=jerky)
    b.ode(lambda b, t: {b.x: b.v[t]})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.v[t] ** 2))
    assert rcp.solve(m).objective == pytest.approx(4.0)
    assert b.record.declarations["v"].rate_bounds == (None, pytest.approx(0.3))
    assert b.x.at_start.value == pytest.approx(3.0)


def test_vectors_take_an_indexed_param() -> None:
    m, b = one_phase("go", duration=1.0, elements=2)
    m.q0 = pyo.Param(["hip", "knee"], initialize={"hip": 0.1, "knee": 0.2}, mutable=True)
    m.fixed = pyo.Param([0, 1], initialize={0: 0.3, 1: 0.4})
    b.q = rcp.State(index=["hip", "knee"], initial=m.q0)
    b.p = rcp.State(index=2, initial=m.fixed, final=[m.q0["hip"], 3.0])
    assert pyo.value(b.q_hip_initial_as_stated.body) == pytest.approx(pyo.value(b.q_hip_initial_as_stated.upper))
    assert b.q_knee[0].value == 0.2
    assert (b.p_0[0].fixed, b.p_1[0].value, b.p_1[1].value) == (True, 0.4, 3.0)


def test_what_never_changes_is_a_number() -> None:
    m, b = one_phase("go", duration=1.0, elements=2)
    m.one = pyo.Param(initialize=1.0)
    b.x = rcp.State(initial=m.one, final=(m.one, 2 * m.one), bounds=(None, 3 * m.one), initial_guess=m.one)
    assert b.x[0].fixed
    assert b.x[1].bounds == (1.0, 2.0)
    assert not list(b.component_objects(pyo.Constraint))


@pytest.mark.parametrize(
    ("declared", "message"),
    [
        (lambda m: rcp.State(initial=3 * metre), r"state 'y'.*its initial is '3\*m', in m.*units=m"),
        (lambda m: rcp.State(initial=3 * metre, units=pyo.units.s), r"its initial is '3\*m'.*does not fit.*'s'"),
        (lambda m: rcp.State(bounds=(0, m.x0)), r"its bounds: the side 'x0' may change.*write 0\.5,"),
        (lambda m: rcp.State(initial=(0, m.x0)), r"its initial: the side 'x0' may change"),
        (lambda m: rcp.State(initial=m.many), r"its initial is the indexed 'many'.*Read it at an index"),
        (lambda m: rcp.Control(initial_guess=m.empty), r"its initial guess is 'empty', which has no value"),
    ],
)
def test_what_cannot_be_meant_is_refused(declared: Any, message: str) -> None:
    m = cart()
    m.many, m.empty = pyo.Param([1, 2], initialize=1, mutable=True), pyo.Var()
    with pytest.raises(ModelError, match=message):
        m.go.y = declared(m)
    assert m.go.component("y") is None


def test_what_a_function_has_said_of_a_time_says_nothing_of_the_one_a_hair_before() -> None:
    jump = FunctionOfTime(lambda t: 1.0 if t < -0.5 else 2.0)
    assert [jump(-0.5), jump(-0.5 - 1e-11), jump(-0.5)] == [2.0, 1.0, 2.0]
