"""The judgement of a trajectory: small for what is right, and large for each way of being wrong."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import exact_x, exact_y, one_phase, oscillators, solve

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import TrajectoryError

NO_SUCH_ERROR = {"defect", "continuity", "equations", "bounds", "natural_residual", "product"}


def changed(trajectory: rcp.Trajectory, group: str, name: str, position: int, by: float) -> rcp.Trajectory:
    values = getattr(trajectory, group)[name].copy()
    values[position] += by
    return replace(trajectory, **{group: {**getattr(trajectory, group), name: values}})


def simulated(**options: Any) -> Any:
    m = oscillators(**{"elements": 4, **options})
    m.nothing = pyo.Objective(expr=0)
    solve(m)
    return m.swing


@pytest.mark.casadi
@pytest.mark.parametrize("scheme", [rcp.schemes.radau(2), rcp.schemes.gauss_legendre(3)], ids=str)
@pytest.mark.parametrize("duration", [1.5, rcp.Duration(bounds=(1.5, 1.5))])
def test_a_solved_phase_is_found_right_and_a_changed_value_wrong(scheme: Any, duration: Any) -> None:
    trajectory = simulated(scheme=scheme, duration=duration).trajectory()
    verdict = trajectory.verify()
    assert verdict.largest_violation < 1e-11
    assert verdict.remarks == ()
    assert trajectory.duration == pytest.approx(1.5)
    grid = trajectory.grid
    worse = changed(trajectory, "states", "x", grid.times.index(grid.mesh.boundaries[2]), 0.1).verify()
    assert worse.defect > 0.1
    assert worse.largest_violation == worse.defect
    assert worse.element_error > 0.01
    assert "1." in str(worse)


@pytest.mark.casadi
def test_re_integration_measures_the_error_of_the_scheme() -> None:
    """Over the horizon it is the true error; per element it falls with one order more."""
    errors = []
    for elements in (4, 8):
        trajectory = simulated(elements=elements, scheme="gauss", stages=2).trajectory()
        verdict = trajectory.verify()
        boundaries = np.isin(trajectory.time, trajectory.grid.mesh.boundaries)
        true_x = np.abs(trajectory.x - [exact_x(t) for t in trajectory.time])[boundaries].max()
        true_y = np.abs(trajectory.y - [exact_y(t) for t in trajectory.time])[boundaries].max()
        assert verdict.horizon_error == pytest.approx(max(true_x, true_y), rel=1e-3)
        errors.append(verdict.element_error)
    assert math.log2(errors[0] / errors[1]) == pytest.approx(4 + 1, abs=0.4)


def test_a_relation_with_two_bounds_and_a_side_that_is_a_bound_are_judged() -> None:
    _, b = one_phase(elements=1, scheme="implicit_euler")
    b.u = rcp.Control(bounds=(None, 4), initial_guess=1.5)
    b.v = rcp.Control(bounds=(-1, None), initial_guess=2)

    b.constraint(lambda b, t: pyo.inequality(2, b.u[t], 9), name="window")
    b.complementarity(lambda b, t: rcp.complements(b.u[t], b.v[t]), name="plain_variables")
    verdict = b.trajectory().verify()
    assert verdict.equations == 0.5
    assert (verdict.natural_residual, verdict.product) == (2.5, 7.5)  # min(4 - 1.5, 2 + 1)
    assert changed(b.trajectory(), "signals", "u", 0, 8.0).verify().equations == 0.5


@pytest.mark.casadi
def test_a_jump_between_elements_is_found() -> None:
    phase = simulated(scheme="gauss", stages=2)
    end = changed(phase.trajectory(), "states", "x", -1, 0.25).verify()
    assert end.continuity == pytest.approx(0.25)
    assert end.defect < 1e-11


def hand_made() -> Any:
    """All values set by hand: rates and residuals follow from them."""
    _, b = one_phase(duration=1, elements=2, scheme="implicit_euler")
    b.x = rcp.State(initial=0, final=(None, 2), bounds=(0, 3), derivative_bounds=(-1, 4))
    b.gap = rcp.Algebraic(bounds=(0, 1))
    b.force = rcp.Control(bounds=(0, 5))
    b.k = rcp.Parameter(bounds=(1, 2), initial_guess=1)
    b.ode(lambda b, t: {b.x: b.k * b.force[t]})
    b.residual(lambda b, t: [b.gap[t] == 0.5], name="height")
    b.constraint(limits)
    b.complementarity(touch)
    b.initialize(x=lambda t: 2 * t, gap=0.5, force=2.0)
    return b


def limits(b: Any, t: float) -> Any:
    return {"range": (0, b.force[t], 2), "power": b.force[t] * b.derivative(b.x)[t] <= 4, "none": pyo.Constraint.Skip}


def touch(b: Any, t: float) -> Any:
    # The first point is left out, the last has a pair of each kind.
    return rcp.complements(b.gap[t] >= 0, b.force[t] <= 3) if t == 1 else rcp.Complementarity.Skip


@pytest.mark.parametrize(
    ("group", "name", "position", "by", "found"),
    [
        ("signals", "force", 1, 0.0, {}),  # min(0.5, 3 - 2) is 0.5
        ("signals", "force", 1, 0.5, {"defect": 0.5, "equations": 1.0, "natural_residual": 0.5, "product": 0.25}),
        ("signals", "force", 0, 4.0, {"defect": 4.0, "bounds": 1.0, "equations": 8.0}),
        ("signals", "gap", 0, -0.75, {"equations": 0.75, "bounds": 0.25}),
        ("signals", "gap", 1, 1.0, {"equations": 1.0, "bounds": 0.5, "natural_residual": 1.0, "product": 1.5}),
        ("states", "x", 0, 0.5, {"bounds": 0.5, "defect": 1.0}),  # initial
        ("states", "x", 2, 0.25, {"bounds": 0.25, "defect": 0.5, "equations": 1.0}),  # final
        ("states", "x", 1, 1.5, {"bounds": 1.0, "defect": 3.0, "equations": 6.0}),  # derivative 5, bound 4
    ],
)
def test_each_violation_is_found_with_its_size(
    group: str, name: str, position: int, by: float, found: dict[str, float]
) -> None:
    before = hand_made().trajectory()
    verdict = changed(before, group, name, position, by).verify()
    expected = {"natural_residual": 0.5, "product": 0.5, **found}
    for number in NO_SUCH_ERROR:
        assert getattr(verdict, number) == pytest.approx(expected.get(number, 0.0), abs=1e-12), number


def test_a_parameter_and_a_duration_out_of_bounds_are_found() -> None:
    trajectory = hand_made().trajectory()
    assert replace(trajectory, parameters={"k": 2.5}).verify().bounds == 0.5
    m = oscillators(elements=2, duration=rcp.Duration(bounds=(1, 2)))
    m.swing.duration.set_value(2.75, skip_validation=True)
    assert m.swing.trajectory().verify().bounds == pytest.approx(0.75)


def test_implicit_equations_are_stepped_anew() -> None:
    _, b = one_phase(elements=2, x=rcp.State(initial=0), y=rcp.State(initial=1, initial_guess=lambda t: 1.0 + t))
    b.ode(lambda b, t: {b.y: 1.0})
    b.residual(lambda b, t: b.derivative(b.x)[t] == b.y[t])
    verdict = b.trajectory().verify()
    assert verdict.horizon_error == pytest.approx(1.5)  # x = t + t^2 / 2, and the trajectory has zero
    assert verdict.motion_error == pytest.approx(1.5)


def test_equations_that_do_not_determine_the_motion_are_named() -> None:
    m, b = one_phase(elements=2, x=rcp.State(initial=0), y=rcp.State(initial=0), u=rcp.Control(), w=rcp.Control())
    b.ode(lambda b, t: {b.y: b.u[t]})

    def implicit(b, t):
        return [b.derivative(b.x)[t] == b.w[t], b.w[t] == b.x[t] + b.u[t] ** 2, b.w[t] == b.y[t] - b.u[t]]

    b.residual(implicit)
    for variable in m.component_data_objects(pyo.Var):
        variable.set_value(0.0)
    assert b.trajectory().verify().motion_error == pytest.approx(0.0, abs=1e-9)
    b.implicit.deactivate()
    verdict = b.trajectory().verify()
    assert (verdict.element_error, verdict.horizon_error, verdict.motion_error) == (None, None, None)
    assert "depends on 'd x'" in verdict.remarks[0]
    assert "not available" in str(verdict)


@pytest.mark.parametrize("rate", [2.0, 3.0])
def test_a_derivative_that_a_right_hand_side_reads_is_followed_between_the_points(rate: float) -> None:
    _, b = one_phase(elements=2)
    b.x, b.y = (
        rcp.State(initial=0, initial_guess=lambda t: 2 * t),
        rcp.State(initial=0, initial_guess=lambda t: rate * t),
    )
    b.ode(lambda b, t: {b.x: 2.0})
    b.ode(lambda b, t: {b.y: b.derivative(b.x)[t]})
    assert b.trajectory().verify().motion_error == pytest.approx(rate - 2.0, abs=1e-9)


def test_rows_that_were_not_stated_through_the_phase_are_named_as_not_judged() -> None:
    m = pyo.ConcreteModel()
    m.T = pyo.Param(initialize=1.0, mutable=True)
    m.phase = phase = rcp.PhaseBlock(elements=2, duration=m.T, free_element_widths=(0.5, 2.0))
    phase.x = rcp.State(initial=0)
    phase.ode(lambda b, t: {b.x: 0.0})
    assert not phase.trajectory().verify().remarks
    phase = hand_made()
    phase.own_limit = pyo.Constraint(expr=phase.x[1.0] <= 1)
    phase.own_pair = rcp.Complementarity(expr=rcp.complements(phase.x[1.0] >= 0, phase.k >= 1))
    (remark,) = phase.trajectory().verify().remarks
    assert remark == "not checked, since they were not stated through the phase: own_limit, own_pair."


def test_a_foreign_trajectory_is_refused() -> None:
    phase, other = hand_made(), oscillators().swing
    trajectory = phase.trajectory()
    with pytest.raises(TrajectoryError, match=r"has the states \['x'\], phase 'swing' has \['x', 'y'\]"):
        trajectory.verify(other)
    with pytest.raises(TrajectoryError, match=r"has the algebraics and controls \['gap'\]"):
        replace(trajectory, signals={"gap": trajectory.gap}).verify()
    with pytest.raises(TrajectoryError, match=r"has the parameters \[\], .* has \['k'\]"):
        replace(trajectory, parameters={}).verify()


def test_a_trajectory_on_another_mesh_can_be_judged() -> None:
    coarse, fine = oscillators(elements=2).swing, oscillators(elements=5).swing
    assert coarse.trajectory().verify(fine) == coarse.trajectory().verify()


@pytest.mark.casadi
def test_path_constraints_on_controls_and_rates_are_looked_at_between_the_points() -> None:
    m, b = one_phase(duration=rcp.Duration(bounds=(0.5, 20), initial_guess=3), elements=6)
    b.x, b.v, b.w = rcp.State(initial=0, final=2), rcp.State(initial=0, final=0), rcp.State(initial=1, final=0)
    b.u, b.f = rcp.Control(rate_bounds=(-3, 3)), rcp.Control()
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t], b.w: b.f[t]})
    b.constraint(lambda b, t: b.u[t] ** 2 + b.f[t] ** 2 <= 1, name="circle")
    b.constraint(lambda b, t: b.u[t] <= 5 + b.points.ord(t), name="by_place")
    m.cost = pyo.Objective(expr=b.duration)
    rcp.solve(m, mesh_tolerance=None, progress=False)
    plan = b.trajectory()
    found, widths = plan.verify(), np.diff(plan.grid.mesh.boundaries)
    inside = (
        np.array(plan.grid.mesh.boundaries[:-1])[:, None] + np.outer(widths, np.linspace(0.001, 0.999, 400))
    ).ravel()
    values = plan(inside)
    assert found.bounds_passed["circle"].excess == pytest.approx(
        (values["u"] ** 2 + values["f"] ** 2 - 1).max(), rel=0.05
    )
    slopes = (plan(inside + 1e-6)["u"] - plan(inside - 1e-6)["u"]) / 2e-6
    assert found.bounds_passed["rate of u"].excess == pytest.approx(np.abs(slopes).max() - 3, rel=0.1)
    assert "'circle' passes its bound 1 by" in found.verdict
    assert any(text.startswith("not looked at between the points: 'by_place'") for text in found.remarks)


@pytest.mark.parametrize(
    ("limit", "by"), [({"max_switches": 1}, 3.0), ({"min_dwell": 1.0}, 0.75), ({"max_switches": 4}, 0)]
)
def test_integer_controls_that_switch_too_often_or_too_soon_are_found(limit: dict[str, float], by: float) -> None:
    _, b = one_phase(duration=2.0, elements=8, scheme="implicit_euler", x=rcp.State(initial=0))
    b.mode = rcp.Control(index=3, integer=(0, 1), one_of=True, **limit)
    b.ode(lambda b, t: {b.x: 0 * b.mode[0, t]})
    for name, values in zip(b.record.names(rcp.Control), np.eye(3)[[0, 1, 2, 0, 0, 0, 1, 1]].T, strict=True):
        for variable, value in zip(b.record.nodes(name).variables(b), values, strict=True):
            variable.set_value(value)
    b.x[:].set_value(0.0)
    assert b.trajectory().verify().bounds == pytest.approx(by)


# --------------------------------------------------------------------
# The verdict on a trajectory says what holds, and why an error that grows over the horizon need not matter.


def falling(rate: float, *, elements: int = 10, **options: Any) -> Any:
    """A model, and the motion of x' = rate * x + u at u = 0 by the scheme of its phase."""
    m, b = one_phase(duration=10.0, elements=elements, x=rcp.State(initial=1), u=rcp.Control(bounds=(-1, 1)), **options)
    b.ode(lambda b, t: {b.x: rate * b.x[t] + b.u[t]})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    assert rcp.solve(m, mesh_tolerance=None).solved
    return m, b.trajectory()


@pytest.mark.ipopt
def test_what_is_integrated_by_the_scheme_holds_and_what_was_changed_does_not():
    m, motion = falling(-0.3)
    verdict = motion.verify(m.p).verdict
    assert verdict.startswith("Verdict: equations and bounds hold at the points of the mesh")
    assert "each element follows its equations" in verdict
    assert "horizon" not in verdict
    assert str(motion.verify(m.p)).endswith(verdict)
    moved = replace(motion, states={"x": motion.states["x"] + np.linspace(0, 1, len(motion.time))})
    assert "does NOT hold: the equations of motion are violated by" in moved.verify(m.p).verdict


@pytest.mark.ipopt
def test_a_coarse_mesh_is_named():
    m, motion = falling(-3.0, elements=3, scheme="implicit_euler")
    verdict = motion.verify(m.p).verdict
    assert "the mesh is coarse" in verdict
    assert "Take more elements." in verdict


@pytest.mark.ipopt
def test_an_error_that_grows_over_the_horizon_is_explained():
    m, b = one_phase(duration=10.0, elements=20, x=rcp.State(initial=0.1, final=0), v=rcp.State(initial=0, final=0))
    b.u = rcp.Control(bounds=(-5, 5))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: 10 * pyo.sin(b.x[t]) + b.u[t]})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    assert rcp.solve(m).solved
    found = b.trajectory().verify()
    assert found.horizon_error > 1e3 * found.element_error
    assert "since the motion is unstable" in found.verdict
    assert "harmless where a controller or replanning corrects" in found.verdict


# --------------------------------------------------------------------
# What has no value on a trajectory is named with its expression, rule and time; nothing else is raised.


def falling_through_zero(state: Callable[[Any, Any], Any]) -> Any:
    """A state that passes zero at t = 1, with a rule that is not defined there or from there on."""
    m, b = one_phase(model="falling_through_zero", duration=2.0, elements=4, x=rcp.State(initial=1), u=rcp.Control())
    state(m, b)
    for variable in b.x.values():
        if not variable.fixed:
            variable.set_value(1.0 - variable.index())
    for variable in (*b.u.values(), *(b.z.values() if hasattr(b, "z") else ())):
        variable.set_value(-1.0)
    return b


def with_root(m: Any, b: Any) -> None:
    b.ode(lambda b, t: {b.x: pyo.sqrt(b.x[t]) + b.u[t]})


def with_limit(m: Any, b: Any) -> None:
    b.ode(lambda b, t: {b.x: b.u[t]})
    b.constraint(lambda b, t: pyo.log(b.x[t] + 0.1) <= 1, name="limit")


def with_algebraic(m: Any, b: Any) -> None:
    b.ode(lambda b, t: {b.x: b.u[t]})
    b.z = rcp.Algebraic()
    b.residual(lambda b, t: b.z[t] == pyo.log(b.x[t] + 0.1), name="level")


@pytest.mark.parametrize(
    ("state", "words"), [(with_root, r"sqrt.*ode"), (with_limit, r"log.*'limit'"), (with_algebraic, r"log.*'level'")]
)
def test_verification_names_expression_rule_and_time(state: Any, words: str) -> None:
    b = falling_through_zero(state)
    with pytest.raises(TrajectoryError, match=rf"phase 'p': {words}.* at time 1\.\d+ \(element 2\)"):
        b.trajectory().verify()


def with_algebraic_in_motion(m: Any, b: Any) -> None:
    b.z = rcp.Algebraic()
    b.ode(lambda b, t: {b.x: b.u[t] + 1e-9 * b.z[t]})
    b.residual(lambda b, t: b.z[t] == pyo.log(b.x[t] + 0.1), name="level")


@pytest.mark.parametrize(("state", "words"), [(with_root, "sqrt"), (with_algebraic_in_motion, "log")])
def test_reintegration_names_what_the_plan_itself_does_not_define(state: Any, words: str) -> None:
    b = falling_through_zero(state)
    with pytest.raises(TrajectoryError, match=rf"{words}.*'x'.* at time 1\.\d+ \(element 2\)"):
        b.reintegrate(b.trajectory())


def test_reintegration_does_not_ask_what_the_motion_does_not_read() -> None:
    b = falling_through_zero(with_algebraic)
    motion = b.reintegrate()
    assert motion.end_errors(motion.local, b.trajectory()) == pytest.approx(0.0, abs=1e-9)
