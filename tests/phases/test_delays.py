"""Delayed values are those of the motion a while ago, on every mesh and wherever a rule is asked."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.checked import unchanged
from harness.phases import contents, one_phase
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError


def decay(mesh: Any, **options: Any) -> Any:
    """x' = -x(t - 1) with x = 1 before: a polynomial between any two whole numbers."""
    m, b = one_phase("go", duration=3.0, mesh=list(mesh), x=rcp.State(initial=1.0, history=1.0), **options)
    b.ode(lambda b, t: {b.x: -b.x.delayed(t, 1.0)})
    return m


def by_hand(t: float) -> float:
    return sum((-1) ** k * (t - k + 1) ** k / math.factorial(k) for k in range(int(t) + 2))


UNEVEN = [0, 0.2, 0.5, 0.9, 1, 1.3, 1.7, 2, 2.2, 3]


@pytest.mark.ipopt
def test_polynomials_between_the_kinks_are_found_exactly_on_any_mesh_that_has_these() -> None:
    m = decay(UNEVEN)
    assert rcp.solve(m).solved
    plan = m.go.trajectory()
    expected = [by_hand(t) for t in plan.time]
    assert plan.x == pytest.approx(expected, abs=1e-12)
    check = plan.verify()
    assert check.largest_violation < 1e-12
    assert check.element_error == pytest.approx(0.0, abs=1e-9)
    assert check.horizon_error == pytest.approx(0.0, abs=1e-9)
    for method in ("DOP853", "scheme"):
        assert m.go.simulate(method=method).x == pytest.approx(expected, abs=1e-8)
    m.go.remesh(9)
    assert rcp.solve(m).solved
    assert m.go.x.at_end.value == pytest.approx(by_hand(3.0), abs=1e-12)


@pytest.mark.ipopt
def test_a_kink_inside_an_element_is_reported_with_its_error() -> None:
    m = decay(np.linspace(0, 3, 8))
    assert rcp.solve(m, mesh_tolerance=None).solved
    plan = m.go.trajectory()
    error = max(abs(plan.x - [by_hand(t) for t in plan.time]))
    check = plan.verify()
    assert check.motion_error is not None
    assert 1e-3 < error == pytest.approx(check.motion_error, rel=0.5)
    # A trajectory of another mesh is judged by the same equations.
    exact = decay(UNEVEN)
    assert rcp.solve(exact).solved
    assert plan.verify(exact.go).defect < 1e-9
    assert exact.go.trajectory().verify(m.go).defect < 1e-8


def test_the_order_of_the_scheme_stays() -> None:
    # x' = -x(t - pi/2) has the solution sin(t).
    errors = []
    for elements in (4, 8):
        _, b = one_phase("go", duration=4.0, elements=elements, x=rcp.State(initial=0.0, history=math.sin))
        b.ode(lambda b, t: {b.x: -b.x.delayed(t, math.pi / 2)})
        found = b.simulate(method="scheme")
        errors.append(abs(found.x - np.sin(found.time)).max())
    assert math.log2(errors[0] / errors[1]) > 3.7


def stirred_tank(mesh: Any) -> Any:
    """Two delays, of the state and of the control, as in Göllmann, Kern & Maurer (2009), doi:10.1002/oca.843."""
    m, b = one_phase("go", duration=3.0, mesh=mesh, x=rcp.State(initial=1.0, history=1.0, initial_guess=1.0))
    b.u = rcp.Control(history=0.0)
    b.ode(lambda b, t: {b.x: b.x.delayed(t, 1.0) * b.u.delayed(t, 2.0)})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2))
    return m


@pytest.mark.ipopt
def test_an_optimum_with_delays_has_its_value_and_its_motion() -> None:
    # x = 1 until t = 2; then x' = x(t - 1) u(t - 2) = u(t - 2). So the first second of u leads x over the third:
    # minimise 2 + int_0^1 ((1 + y)^2 + u^2), y' = u, y(0) = 0, which gives 2 + tanh(1).
    expected = 2 + math.tanh(1)
    piece = np.array([0.0, 0.1, 0.25, 0.6, 1.0])
    m = stirred_tank(np.concatenate([piece, piece[1:] + 1, piece[1:] + 2]))
    assert rcp.solve(m).solved
    assert pyo.value(m.cost) == pytest.approx(expected, abs=1e-6)
    plan = m.go.trajectory()
    # There y'' = 1 + y and y'(1) = 0.
    ends = np.array(plan.grid.mesh.boundaries)
    exact = np.where(ends < 2, 1.0, np.cosh(3 - ends) / math.cosh(1))
    assert plan(ends)["x"] == pytest.approx(exact, abs=1e-6)
    assert m.go.simulate().x == pytest.approx(plan.x, abs=1e-6)
    check = plan.verify()
    assert check.largest_violation < 1e-6
    assert check.integral_error is not None
    assert check.integral_error < 1e-5


@given(delay=st.floats(0.05, 2.5), seed=st.integers(0, 100))
@settings(max_examples=15, deadline=None)
def test_delayed_polynomials_are_exact_for_polynomials(delay: float, seed: int) -> None:
    cubic = np.polynomial.Polynomial(np.random.default_rng(seed).normal(size=4))
    m, b = one_phase("go", duration=2.0, mesh=[0, 0.3, 1.1, 2.0])
    m.delay = pyo.Param(initialize=delay, mutable=True)
    b.x = rcp.State(history=lambda t: cubic(t), initial_guess=lambda t: cubic(t))
    b.u = rcp.Control(index=2, history=lambda t: [2 * t, 3 - t], initial_guess=lambda t: [2 * t, 3 - t])
    for t in b.points:
        assert pyo.value(b.x.delayed(t, m.delay)) == pytest.approx(cubic(t - delay), abs=1e-9)
        delayed = [pyo.value(entry) for entry in b.u.delayed(t, m.delay)]
        assert delayed == pytest.approx([2 * (t - delay), 3 - (t - delay)], abs=1e-9)
    for time in (0.0, 0.2, 1.1, 1.7, 2.0):
        assert pyo.value(b.x.at(time)) == pytest.approx(cubic(time), abs=1e-9)
        assert [pyo.value(entry) for entry in b.u.at(time)] == pytest.approx([2 * time, 3 - time], abs=1e-9)


def test_delays_shorter_than_an_element_and_of_many_horizons() -> None:
    # x' = -x(t - delay): by steps of SciPy whatever the elements are.
    for delay in (0.07, 5.0):
        ends = []
        for elements in (2, 7):
            _, b = one_phase("go", duration=1.0, elements=elements, x=rcp.State(initial=1.0, history=lambda t: 1.0 + t))
            b.ode(lambda b, t, delay=delay: {b.x: -b.x.delayed(t, delay)})
            ends.append(b.simulate().x[-1])
        assert ends[0] == pytest.approx(ends[1], abs=1e-7)
    assert ends[0] == pytest.approx(1.0 - (1 + 0.5 - 5), abs=1e-7)  # 1 - int_0^1 (1 + t - 5)


@pytest.mark.parametrize("elements", [2, 20])
def test_the_rows_of_an_element_may_read_earlier_times_of_the_same_element(elements: int) -> None:
    _, b = one_phase("go", duration=1.0, elements=elements, x=rcp.State(initial=1.0, history=1.0))
    b.ode(lambda b, t: {b.x: -b.x.delayed(t, 0.1)})
    by_rows = b.simulate(method="scheme")
    assert by_rows.x == pytest.approx(b.simulate()(by_rows.time)["x"], abs=5e-3 if elements == 2 else 1e-5)
    assert by_rows.verify().defect < 1e-8


def test_a_phase_goes_on_from_the_history_of_the_one_before() -> None:
    m = pyo.ConcreteModel()
    m.first = rcp.PhaseBlock(duration=2.0, mesh=[0, 1, 2])
    m.second = rcp.PhaseBlock(start=2.0, duration=1.0, elements=3)
    m.first.x = rcp.State(initial=1.0, history=1.0)
    m.second.x = rcp.State(history=lambda t: m.first.x.at(t))
    for b in (m.first, m.second):
        b.ode(lambda b, t: {b.x: -b.x.delayed(t, 1.0)})
    m.go_on = rcp.Link(m.first, m.second)
    m.first.initialize(m.first.simulate())
    found = m.second.simulate(initial=m.go_on.start_after(m.first.trajectory()))
    assert found.x == pytest.approx([by_hand(t) for t in found.time], abs=1e-7)


def test_values_at_times_follow_the_mesh_and_stand_in_rules() -> None:
    m, b = one_phase("go", duration=2.0, elements=4, scheme="gauss", x=rcp.State(initial_guess=lambda t: t**2))
    b.u = rcp.Control(initial_guess=lambda t: t)
    b.w = rcp.Control(parametrization="piecewise_linear", initial_guess=lambda t: 3 * t)
    b.k = rcp.Control(parametrization="piecewise_constant", initial_guess=lambda t: t)
    b.ode(lambda b, t: {b.x: b.u[t] + b.u.at_end + b.w[t] + b.k[t]})
    m.between = pyo.Constraint(expr=b.x.at(0.7) + b.u.at_start == 0.49)
    assert b.x.at_end is b.x[2.0]
    assert pyo.value(m.between.body) == pytest.approx(0.49)
    values = {"u": (0.0, 2.0), "w": (0.0, 6.0), "k": (0.25, 1.75)}
    for mesh in (None, [0, 0.4, 1.9, 2.0]):
        if mesh is not None:
            b.remesh(mesh)
            values["k"] = (0.25, 1.75)
        for name, (first, last) in values.items():
            control = b.component(name)
            assert pyo.value(control.at_start) == pytest.approx(first, abs=1e-9)
            assert pyo.value(control.at_end) == pytest.approx(last, abs=1e-9)
        assert pyo.value(m.between.body) == pytest.approx(0.49)
    twin = m.clone()
    assert pyo.value(twin.between.body) == pytest.approx(0.49)


def phase(**options: Any) -> Any:
    m, _ = one_phase("go", x=rcp.State(initial=1.0), **{"duration": 1.0, "elements": 2, **options})
    m.go.h = rcp.State(initial=1.0, history=math.nan)
    return m.go


@pytest.mark.parametrize(
    ("block", "ask", "message"),
    [
        (phase, lambda b: b.x.delayed(0.5, 2.0), r"'x' is delayed by 2 at t = 0.5.*State\(history="),
        (phase, lambda b: b.ode(lambda b, t: {b.x: b.x.delayed(t, 9)}), r"State\(history=.*test_delays.py"),
        (phase, lambda b: b.x.delayed(0.5, -0.1), "0 or more"),
        (phase, lambda b: b.x.delayed(0.5, math.inf), "0 or more"),
        (phase, lambda b: b.x.delayed(0.5, "long"), "expected a number or a Param"),
        (phase, lambda b: b.x.delayed(0.5, b.x[0]), "to be found"),
        (phase, lambda b: b.h.delayed(0.5, 2.0), "its history .* is nan"),
        (phase, lambda b: b.x.at(1.5), "run from 0 to 1"),
        (lambda: phase(duration=rcp.Duration(bounds=(1, 2))), lambda b: b.x.delayed(1, 0.1), "its duration"),
        (lambda: phase(free_element_widths=(0.5, 2)), lambda b: b.x.delayed(1, 0.1), "boundaries of its elements"),
    ],
)
def test_what_has_no_delayed_value_is_refused_by_name(
    block: Callable[[], Any], ask: Callable[[Any], Any], message: str
) -> None:
    b = block()
    with unchanged(contents, b), pytest.raises(ModelError, match=f"(?s)phase 'go'.*{message}"):
        ask(b)


def test_a_phase_with_a_free_start_knows_its_delays() -> None:
    _, b = one_phase("go", start=rcp.Start(bounds=(0, 5), initial_guess=3.0), duration=2.0, elements=4)
    b.x = rcp.State(initial=1.0, history=lambda t: t, initial_guess=lambda s: 2 * s)
    assert pyo.value(b.x.delayed(1.0, 0.5)) == pytest.approx(1.5)
    assert pyo.value(b.x.delayed(0.25, 1.0)) == pytest.approx(3.0 + 0.5 - 1.0)
    with pytest.raises(ModelError, match="no equation"):
        b.check()


@pytest.mark.ipopt
def test_refined_meshes_agree_with_the_method_of_steps_of_scipy() -> None:
    m, b = one_phase("go", duration=3.0, mesh=[0, 0.3, 1, 1.5, 2, 3], x=rcp.State(initial=1.0, history=1.0))
    b.ode(lambda b, t: {b.x: -b.x.delayed(t, 1.0) * (1 + 0.3 * b.x[t])})
    m.cost = pyo.Objective(expr=b.x.at_end)
    assert rcp.solve(m, mesh_tolerance=2e-8).solved
    plan = b.trajectory()
    widths = plan.grid.mesh.widths
    assert widths.max() > 1.5 * widths.min()
    pieces: list[Any] = []

    def past(t: float) -> float:
        return 1.0 if t <= 0 else float(pieces[min(math.ceil(t) - 1, len(pieces) - 1)](t)[0])

    at = np.ones(1)
    for start in (0.0, 1.0, 2.0):
        found = solve_ivp(
            lambda t, x: [-past(t - 1) * (1 + 0.3 * x[0])], (start, start + 1), at,
            method="DOP853", rtol=1e-11, atol=1e-12, dense_output=True,
        )  # fmt: skip
        pieces.append(found.sol)
        at = found.y[:, -1]
    assert plan.x == pytest.approx([past(t) for t in plan.time], abs=1e-6)
