"""Start, duration and element boundaries as variables."""

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import integrator, one_phase, rest_to_rest
from mistakes.entries import cart, driven, newton
from pyomo.core.expr.visitor import identify_variables

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError


def in_least_time(elements: int, low: float, high: float, **options: Any) -> pyo.ConcreteModel:
    """Full force, then full brake."""
    options = {"free_element_widths": (0.1, 3), "stages": 2, **options}
    duration = rcp.Duration(bounds=(0.1, 10), initial_guess=1.5)
    held = {"parametrization": "piecewise_constant"}
    return rest_to_rest(force=(low, high), u=held, duration=duration, elements=elements, **options)


@pytest.mark.ipopt
@pytest.mark.parametrize("elements", [2, 3, 5])
@pytest.mark.parametrize(("low", "high"), [(-1.0, 1.0), (-2.0, 1.0), (-0.5, 1.0)])
def test_the_switch_of_a_minimum_time_plan_falls_on_an_element_end(elements: int, low: float, high: float) -> None:
    m = in_least_time(elements, low, high)
    result = rcp.solve(m)
    least = math.sqrt(2 * (1 / high - 1 / low))
    switch = least * -low / (high - low)
    assert result.objective == pytest.approx(least, abs=1e-6)
    boundaries = np.array(m.p.trajectory().grid.mesh.boundaries)
    assert np.abs(boundaries - switch).min() < 1e-5
    verdict = m.p.trajectory().verify()
    assert verdict.largest_violation < 1e-6
    assert verdict.horizon_error < 1e-6


@pytest.mark.ipopt
def test_on_a_mesh_that_stands_still_the_same_plan_is_worse() -> None:
    least = math.sqrt(3.0)
    still = rcp.solve(in_least_time(5, -2, 1, free_element_widths=None), mesh_tolerance=None).objective
    assert still > least + 1e-3


@pytest.mark.parametrize("scheme", ["radau", "gauss", "trapezoid", "hermite_simpson", "explicit"])
def test_moved_elements_integrate_and_tell_the_time(scheme: str) -> None:
    """With boundaries put anywhere, integrals and the clock are those of the moved mesh."""
    _, b = one_phase(duration=3.0, start=1.0, elements=4, scheme=scheme, free_element_widths=(0.2, 3))
    cost = b.integral(lambda b, t: b.time_at(t))
    for each, fraction in zip(b.boundary.values(), [0, 0.1, 0.35, 0.8, 1.0], strict=True):
        each.set_value(fraction)
    assert pyo.value(cost) == pytest.approx((4.0**2 - 1.0) / 2, rel=1e-12 if scheme != "explicit" else 0.2)
    clocks = [pyo.value(b.time_at(t)) for t in b.time]
    assert clocks == sorted(clocks)
    assert clocks[0] == 1.0
    assert clocks[-1] == pytest.approx(4.0)
    assert {round(t, 12) for t in (1.3, 2.05, 3.4)} <= {round(t, 12) for t in clocks}
    b.x = rcp.State(initial_guess=0)
    np.testing.assert_allclose(b.trajectory().time, clocks)


@pytest.mark.ipopt
def test_a_free_start_waits_for_the_best_moment() -> None:
    # The wind blows as (t - 4)^2: a ride of length 2 is cheapest around 4.
    start = rcp.Start(bounds=(0, 10), initial_guess=1)
    m, b = integrator(x={"initial": 0, "final": 1}, duration=2.0, start=start, elements=5)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 + (b.time_at(t) - 4) ** 2))
    assert rcp.solve(m).solved
    assert m.p.start.value == pytest.approx(3.0, abs=1e-6)
    trajectory = b.trajectory()
    assert (trajectory.time[0], trajectory.time[-1]) == pytest.approx((3.0, 5.0), abs=1e-6)
    assert trajectory.verify().largest_violation < 1e-7


@pytest.mark.ipopt
def test_a_phase_can_start_where_another_ends() -> None:
    m = pyo.ConcreteModel()
    m.first = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.5, 2), initial_guess=1), elements=3)
    m.second = rcp.PhaseBlock(duration=1.0, start=m.first.duration + 0.5, elements=3)
    for b in (m.first, m.second):
        b.x = rcp.State(initial=0)
        b.ode(lambda b, t: {b.x: b.time_at(t)})
    m.first.duration.fix(1.5)
    m.cost = pyo.Objective(expr=0.0 * m.first.x[1.0])
    assert rcp.solve(m).solved
    assert m.second.x[1.0].value == pytest.approx((3.0**2 - 2.0**2) / 2)
    copy = m.clone()
    copy.first.duration.fix(0.5)
    assert pyo.value(copy.second.time_at(0.0)) == 1.0
    assert pyo.value(m.second.time_at(0.0)) == 2.0


@pytest.mark.parametrize("duration", [0.0, -1.0, None])
def test_a_duration_without_a_positive_value_is_refused_by_name(duration: float | None) -> None:
    m = in_least_time(3, -2, 1)
    plan = m.p.trajectory()
    m.p.duration.set_value(duration, skip_validation=True)
    m.p.check()  # for a solver it is a guess
    for read in (m.p.trajectory, m.p.reintegrate, lambda: m.p.initialize(plan)):
        with pytest.raises(ModelError, match=r"phase 'p': its duration has the value .*must be positive.*p.duration"):
            read()
    m.p.duration.fix()
    with pytest.raises(ModelError, match="phase 'p': its duration has the value"):
        m.p.check()


def test_a_motion_that_lasts_longer_than_a_plan_may_is_verified_in_silence(caplog: pytest.LogCaptureFixture) -> None:
    m = in_least_time(3, -2, 1)
    m.p.duration.set_value(50.0, skip_validation=True)
    motion = m.p.trajectory()
    m.p.duration.set_value(5.0)
    verified = motion.verify()
    assert verified.bounds > 1.0
    assert not caplog.records
    assert m.p.duration.value == 5.0


@pytest.mark.parametrize(
    "bounds",
    [lambda t: (0, 2 * t), lambda t: (0, 1 if t < 0.5 else 2), lambda t: (0, pyo.Expr_if(t < 2, 1, 2))],
    ids=["a formula", "a branch", "a choice"],
)
def test_bounds_over_a_time_that_is_to_be_found_are_refused_as_in_a_rule(bounds: Any) -> None:
    _, b = one_phase(duration=rcp.Duration(bounds=(1, 9)), elements=3)
    for declaration in (rcp.Control(bounds=bounds), rcp.State(bounds=bounds), rcp.Control(bounds=bounds, index=2)):
        with pytest.raises(ModelError, match=r"its bounds (depend on|have to know) the time.*b\.constraint"):
            b.u = declaration
    b.u = rcp.Control(bounds=lambda t: (0, 1))  # the same at all times
    assert {(u.lb, u.ub) for u in b.u.values()} == {(0, 1)}


# --------------------------------------------------------------------
# What a newcomer writes first about the time: the message names the place and what to write instead; that works.


def test_a_boundary_is_found_by_its_number_whatever_its_rounding():
    _, b = one_phase(duration=2.4, elements=24, x=rcp.State(), v=rcp.State(index=2))
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
