"""Planning again and again: the same plans as from scratch, at no preparation, and no plan is ever lost."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import with_phase
from harness.scenes import keep_clear, on_the_line

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ComplementarityError, ModelError

pytestmark = pytest.mark.casadi

PARAMETRIZATIONS = ["collocated", "piecewise_constant", "piecewise_linear"]


def regulator(parametrization: str = "collocated", start: float = 1.0, **options: Any) -> pyo.ConcreteModel:
    m, b = with_phase("ahead", "regulator", **{"duration": 3.0, "elements": 12, **options})
    b.x = rcp.State(initial=start)
    b.v = rcp.State(initial=0, derivative_bounds=(-3, 3))
    b.u = rcp.Control(bounds=(-2, 2), parametrization=parametrization)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: pyo.sin(b.x[t]) + b.u[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.v[t] ** 2 + 0.1 * b.u[t] ** 2))
    return m


@pytest.mark.parametrize("parametrization", PARAMETRIZATIONS)
def test_each_plan_is_that_of_a_model_built_from_scratch(parametrization: str) -> None:
    m = regulator(parametrization)
    controller = rcp.studies.RecedingHorizon(m, m.ahead)
    state = {"x": 0.5, "v": 0.2}
    for k in range(6):
        step = controller.step(state, advance=0.2 if k else 0.0)
        assert step.solved
        fresh = regulator(parametrization, state["x"])
        fresh.ahead.v[0.0].set_value(state["v"])
        result = rcp.solve(fresh)
        assert pyo.value(m.cost) == pytest.approx(result.objective, rel=1e-6)
        times = np.linspace(0, 3, 31)
        expected, plan = fresh.ahead.trajectory()(times), step.plan(times)
        for name in expected:
            np.testing.assert_allclose(plan[name], expected[name], atol=2e-4)
        state = {name: step.plan(0.2)[name] for name in ("x", "v")}
    assert controller.program.preparations == 1


def test_the_loop_settles_and_its_steps_are_short() -> None:
    m = regulator("piecewise_constant")
    controller = rcp.studies.RecedingHorizon(m, m.ahead)
    state = {"x": 1.0, "v": 0.0}
    first = controller.step(state)
    iterations = []
    for _ in range(20):
        step = controller.step(state, advance=0.25)
        iterations.append(step.iterations)
        state = {name: step.plan(0.25)[name] for name in state}
    assert abs(state["x"]) < 0.02
    assert np.mean(iterations[5:]) <= 0.7 * first.iterations
    assert step.seconds >= step.ipopt_seconds > 0


WRONG_STEPS = {
    "missing": ({"x": 1.0}, 0.0, "phase 'ahead': 'v' has no value in the measured state; needed are v, x"),
    "unknown": ({"x": 1.0, "v": 0.0, "u": 1.0}, 0.0, "'u' has no fixed initial value"),
    "nan": ({"x": float("nan"), "v": 0.0}, 0.0, "the measured 'x' is nan"),
    "backwards": ({"x": 1.0, "v": 0.0}, -0.1, "advance = -0.1; expected a time between 0 and 3"),
}


@pytest.mark.parametrize("case", WRONG_STEPS)
def test_a_senseless_measurement_is_refused(case: str) -> None:
    state, advance, message = WRONG_STEPS[case]
    m = regulator()
    controller = rcp.studies.RecedingHorizon(m, m.ahead)
    with pytest.raises(ModelError, match=message):
        controller.step(state, advance)


def test_what_cannot_recede_is_refused() -> None:
    m = regulator(duration=rcp.Duration(bounds=(1, 2)))
    with pytest.raises(ModelError, match="phase 'ahead': a receding horizon needs a fixed start, a fixed duration"):
        rcp.studies.RecedingHorizon(m, m.ahead)
    with pytest.raises(ModelError, match="'ahead' is no phase of 'regulator'"):
        rcp.studies.RecedingHorizon(regulator(), m.ahead)
    m = regulator()
    m.pair = rcp.Complementarity(expr=rcp.complements(m.ahead.u[3.0] >= 0, m.ahead.x[3.0] >= 0))
    with pytest.raises(ComplementarityError, match="'regulator' has active complementarity pairs"):
        rcp.studies.RecedingHorizon(m, m.ahead)
    pyo.TransformationFactory("pyrobocop.relax_complementarity").apply_to(m, delta=1e-4)
    assert rcp.studies.RecedingHorizon(m, m.ahead).step({"x": 0.3, "v": 0.0}).solved


def crossing(truck: Any) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel(name="crossing")
    m.now = pyo.Param(initialize=0.0, mutable=True)
    m.ahead = b = rcp.PhaseBlock(duration=3.0, elements=6, stages=2)
    b.x, b.v, b.u = rcp.State(initial=0.0), rcp.State(initial=1.0), rcp.Control(bounds=(-2, 2))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.v[t] - 1) ** 2 + 0.1 * b.u[t] ** 2))
    b.initialize({"x": lambda t: t, "v": 1.0, "u": 0.0})
    keep_clear(b, rcp.Polytope.box(0.4, 0.2), {"truck": rcp.Body(rcp.Polytope.box(0.4, 0.4), truck)}, on_the_line, 0.1)
    return m


def test_each_step_says_whether_it_is_safe_from_what_moves() -> None:
    m = crossing(lambda b, t: rcp.planar_pose(2, 2 * (t + b.model().now) - 6))
    controller = rcp.studies.RecedingHorizon(m, m.ahead)
    state, verdicts = {"x": 0.0, "v": 1.0}, []
    for k in range(4):
        m.now = 0.4 * k
        step = controller.step(state, advance=0.4 if k else 0.0)
        verdicts.append((step.solved, step.safe))
        state = {name: step.plan(0.4)[name] for name in state}
    assert verdicts[0] == (True, True)
    assert all(safe is True for solved, safe in verdicts if solved)
    m.now = 1.7  # the truck is somewhere else than foreseen: in the way
    report = m.ahead.avoid.verify()
    step = controller.step(state, time_limit=0.0)
    assert not step.solved
    assert step.safe == step.safety.safe
    assert "phase 'ahead'" in step.safety.motion
    assert report.body_pairs[0].clearance == 0.1


def test_an_obstacle_that_would_start_anew_with_each_step_is_told(caplog: pytest.LogCaptureFixture) -> None:
    m = crossing(lambda b, t: rcp.planar_pose(2, 2 * t - 6))
    rcp.studies.RecedingHorizon(m, m.ahead)
    assert "'truck' moves with the time of its phase" in caplog.text
    assert "b.now" in caplog.text


def test_without_obstacles_nothing_is_said_of_safety() -> None:
    m = regulator()
    assert rcp.studies.RecedingHorizon(m, m.ahead).step({"x": 0.5, "v": 0.0}).safe is None


def test_first_step_starts_where_the_equations_have_values():
    """A guess of zero between the ends, where a rate by exp(-1 / T) has no value."""
    m, b = with_phase("ahead", "reactor", duration=1.0, elements=4)
    b.temperature = rcp.State(initial=350)
    b.initialize({"temperature": 0.0})
    b.heat = rcp.Control(bounds=(-50, 50))
    b.ode(lambda b, t: {b.temperature: b.heat[t] - 1e3 * pyo.exp(-2000 / b.temperature[t])})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.temperature[t] - 340) ** 2 + b.heat[t] ** 2))
    controller = rcp.studies.RecedingHorizon(m, b)
    step = controller.step({"temperature": 352.0})
    assert step.solved
    assert "division by" in step.remark
    assert "division by" in str(step)
    following = controller.step({"temperature": 351.0}, advance=0.25)
    assert following.solved
    assert not following.remark
