"""Step maps: states that a rule leads from one element boundary to the next, without a derivative."""

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.checked import unchanged
from harness.phases import contents

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError, TrajectoryError

IMPLICIT, EXPLICIT = rcp.schemes.radau(1), rcp.schemes.find_scheme("explicit_euler")
each_scheme = pytest.mark.parametrize("scheme", [IMPLICIT, EXPLICIT], ids=str)
ELEMENTS, DURATION = 5, 2.0
STEP = DURATION / ELEMENTS


def rule_pendulum(b: Any, t: float, previous: Any) -> Any:
    return {
        b.theta: previous.theta + STEP * b.omega[t],
        b.omega: previous.omega + STEP * (b.torque[t] - pyo.sin(b.theta[t])),
    }


def phase(scheme: Any = IMPLICIT, model: Any = None) -> Any:
    m = pyo.ConcreteModel() if model is None else model
    m.p = rcp.PhaseBlock(duration=DURATION, elements=ELEMENTS, scheme=scheme)
    return m.p


def pendulum(scheme: Any = IMPLICIT, by_step: bool = True) -> Any:
    b = phase(scheme)
    b.theta, b.omega = rcp.State(initial=0.5), rcp.State(initial=0)
    b.torque = rcp.Control(bounds=(-9, 9))
    if by_step:
        b.step_map(rule_pendulum)
    else:
        b.ode(lambda b, t: {b.theta: b.omega[t], b.omega: b.torque[t] - pyo.sin(b.theta[t])})
    return b


@each_scheme
def test_the_rows_are_those_of_the_ode(scheme: Any) -> None:
    """At any values, but for the sign and the scale that a row of collocation has."""
    values = np.random.default_rng(0).normal(size=50)
    bodies = []
    for by_step in (True, False):
        b = pendulum(scheme, by_step)
        for variable, number in zip(b.component_data_objects(pyo.Var), values, strict=False):
            variable.set_value(number)
        kind = "step" if by_step else "collocation"
        bodies.append(
            [pyo.value(row.body) for name in ("theta", "omega") for row in b.component(f"{name}_{kind}").values()]
        )
    np.testing.assert_allclose(*bodies, atol=1e-12)


def mixed(scheme: Any = IMPLICIT, model: Any = None) -> Any:
    """A derivative, an algebraic, a map that reads both, and a map without any variable of its own element."""
    b = phase(scheme, model)
    b.v, b.x, b.count = rcp.State(initial=1), rcp.State(initial=0), rcp.State(initial=0)
    b.drag = rcp.Algebraic()
    b.ode(lambda b, t: {b.v: -b.drag[t]})
    b.residual(lambda b, t: b.drag[t] == 2 * b.v[t], name="brake")
    b.step_map(move_and_count)
    return b


def move_and_count(b: Any, t: float, previous: Any) -> Any:
    return {b.x: previous.x + STEP * b.v[t], b.count: previous.count + 1}


@each_scheme
def test_maps_stand_beside_differential_and_algebraic_equations(scheme: Any) -> None:
    b = mixed(scheme)
    b.check()
    trajectory = b.simulate()
    growth = 1 / (1 + 2 * STEP) if scheme is IMPLICIT else 1 - 2 * STEP
    v = growth ** np.arange(ELEMENTS + 1)
    np.testing.assert_allclose(trajectory.v, v, atol=1e-9)
    np.testing.assert_allclose(np.diff(trajectory.x), STEP * (v[1:] if scheme is IMPLICIT else v[:-1]), atol=1e-9)
    np.testing.assert_allclose(trajectory.count, np.arange(ELEMENTS + 1), atol=1e-12)
    assert trajectory.verify().largest_violation < 1e-9
    assert set(trajectory.rates) == {"v"}
    middle = (trajectory.time[1] + trajectory.time[2]) / 2
    assert trajectory(middle)["x"] == pytest.approx((trajectory.x[1] + trajectory.x[2]) / 2)


@each_scheme
def test_a_changed_value_is_found_and_what_is_not_checked_is_said(scheme: Any) -> None:
    trajectory = mixed(scheme).simulate()
    verdict = trajectory.verify()
    assert verdict.element_error is None
    assert verdict.horizon_error is None
    (remark,) = verdict.remarks
    assert "of count, x. Step maps lead them" in remark
    assert "phase.simulate()" in remark
    for name in ("x", "count"):
        wrong = trajectory.states[name].copy()
        wrong[-1] += 0.125
        worse = replace(trajectory, states={**trajectory.states, name: wrong}).verify()
        assert worse.defect == pytest.approx(0.125)


def test_files_clones_and_pickles_know_the_maps(tmp_path: Path) -> None:
    model = pyo.ConcreteModel()
    b = mixed(model=model)
    trajectory = b.simulate()
    loaded = rcp.Trajectory.load(trajectory.save(tmp_path / "mixed"))
    assert loaded.verify(b).largest_violation < 1e-9
    for copied in (model.clone(), pickle.loads(pickle.dumps(model))):
        twin = copied.p
        twin.check()
        assert twin.record.discrete_states == {"x", "count"}
        assert twin.verify(loaded).largest_violation < 1e-9
        np.testing.assert_allclose(twin.simulate().x, trajectory.x)
        with pytest.raises(ModelError, match="'x' has no derivative; the step map 'move_and_count' leads it"):
            twin.derivative(twin.x)


def test_a_map_reads_another_phase_a_parameter_and_the_duration() -> None:
    m = pyo.ConcreteModel()
    m.wind = rcp.PhaseBlock(duration=DURATION, elements=ELEMENTS, scheme="implicit_euler")
    m.wind.speed = rcp.Control(initial_guess=lambda t: t)
    m.p = b = rcp.PhaseBlock(
        duration=rcp.Duration(bounds=(1, 3), initial_guess=2.0), elements=ELEMENTS, scheme="implicit_euler"
    )
    b.x = rcp.State(initial=1)
    b.k = rcp.Parameter(initial_guess=0.5)

    @b.step_map
    def drift(b: Any, t: float, previous: Any) -> Any:
        return {b.x: previous.x + b.k * b.duration / ELEMENTS * b.model().wind.speed[b.model().wind.points.at(1)]}

    trajectory = b.simulate()
    assert trajectory.x[-1] == pytest.approx(1 + 0.5 * 2.0 * STEP)
    assert trajectory.verify().largest_violation < 1e-12


def refused(b: Any, rule: Any, message: str) -> None:
    with unchanged(contents, b), pytest.raises(ModelError, match=message):
        b.step_map(rule)
    assert not b.record.discrete_states


@pytest.mark.parametrize(
    "scheme", [rcp.schemes.radau(2), rcp.schemes.gauss_legendre(1), rcp.schemes.lobatto(2)],
    ids=str,
)  # fmt: skip
def test_an_element_is_one_step(scheme: Any) -> None:
    b = phase(scheme)
    b.x = rcp.State(initial=0)
    refused(
        b, lambda b, t, previous: {b.x: previous.x}, r"step map '<lambda>' leads from .* but .*\(\d\) has \d stages, or"
    )


def test_what_is_no_map_is_refused() -> None:
    model = pyo.ConcreteModel()
    b = phase(model=model)
    b.x, b.y = rcp.State(initial=0), rcp.State(initial=0, derivative_bounds=(-1, 1))
    b.z = rcp.State(initial=0)
    b.u = rcp.Control()
    b.derivative(b.z)
    refused(b, lambda b, t, previous: None, "returned nothing at t = 0.4; expected a dict {state: value}. Is the ret")
    refused(b, lambda b, t, previous: {b.u: 1.0}, "'u' is no state; its states are x, y, z")
    refused(b, lambda b, t, previous: {b.x: b.u}, r"gives 'p.u' as the next value of 'x'.* Is an index \[t\] missing")
    refused(b, lambda b, t, previous: {b.x: previous.u}, "reads previous.u; only states .* of the phase are x, y, z")
    refused(b, lambda b, t, previous: {b.x: 0.0} if t > 1 else {}, "gives no next value of 'x' at t = 0.4")
    refused(b, lambda b, t, previous: {b.y: 0.0}, r"next value of 'y' \(declared at .*\), whose derivative is in use")
    refused(b, lambda b, t, previous: {b.z: 0.0}, r"next value of 'z' \(declared at .*\), whose derivative is in use")


def test_a_state_has_one_equation() -> None:
    b = phase()
    b.x, b.y = rcp.State(initial=0), rcp.State(initial=0)
    b.ode(lambda b, t: {b.x: 1.0})
    with pytest.raises(ModelError, match="second equation for state 'x'; '<lambda>' has given one"):
        b.step_map(lambda b, t, previous: {b.x: previous.x})
    with pytest.raises(ModelError, match=r"'y' .* no equation. State its .* its next value in a step"):
        b.check()
    b.step_map(lambda b, t, previous: {b.y: previous.y})
    with pytest.raises(ModelError, match="second equation for state 'y'; '<lambda>' has given one"):
        b.ode(lambda b, t: {b.y: 1.0})
    with pytest.raises(ModelError, match="'y' has no derivative; the step map '<lambda>' leads it"):
        b.derivative("y")
    b.check()


def test_there_is_no_error_of_discretisation() -> None:
    b = mixed()
    with pytest.raises(TrajectoryError, match="no error of discretisation of count, x. Step maps lead them"):
        b.reintegrate(b.simulate())
    other = phase(rcp.schemes.radau(2))
    other.v, other.x, other.count = rcp.State(initial=1), rcp.State(initial=0), rcp.State(initial=0)
    other.drag = rcp.Algebraic()
    with pytest.raises(
        TrajectoryError, match=r"trajectory 'p' is one of radau\(2\); the phase has step maps \(count, x\)"
    ):
        b.verify(other.trajectory())


@pytest.mark.ipopt
def test_a_plan_with_maps_is_found() -> None:
    """The least effort that brings ``x+ = x + u`` from 0 to 1 is the same in every element."""
    model = pyo.ConcreteModel()
    b = phase(model=model)
    b.x = rcp.State(initial=0, final=1)
    b.u = rcp.Control()
    b.step_map(lambda b, t, previous: {b.x: previous.x + b.u[t]})
    model.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    rcp.solve(model).raise_for_status()
    np.testing.assert_allclose(b.trajectory().u, 1 / ELEMENTS, atol=1e-8)
    assert b.trajectory().verify().largest_violation < 1e-8
