"""The estimated error of the objective is that against the continuous optimum, on coarse meshes and by every scheme."""

import pickle
from collections.abc import Callable
from math import cos, cosh, exp, sin, tanh
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from estimate_problems import PROBLEMS
from harness import phases
from harness.checked import solution
from harness.phases import mass, one_phase

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.discretisation.estimates import DiscretisationEstimate, PhaseEstimate, size_of_objective

pytestmark = pytest.mark.casadi


Builder = Callable[..., Any]


def integrator(elements: int, sense: Any = pyo.minimize, **scheme: Any) -> Any:
    """A state that the control moves, both squared for three seconds: tanh(3)."""
    m, b = phases.integrator(x={"initial": 1}, duration=3.0, elements=elements, **scheme)
    sign = 1 if sense == pyo.minimize else -1
    m.cost = pyo.Objective(expr=sign * b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2), sense=sense)
    return m


def ratio(model: Any, exact: float) -> float:
    result = rcp.solve(model)
    result.raise_for_status()
    estimated = result.discretisation.objective_error
    assert estimated is not None, result.discretisation
    return float(estimated / abs(result.objective - exact))


SHARED = {problem.name: problem for problem in PROBLEMS}
RADAU_3, RADAU_2, GAUSS_2 = ({"scheme": s, "stages": k} for s, k in (("radau", 3), ("radau", 2), ("gauss", 2)))
LOBATTO_3, EULER = {"scheme": "lobatto", "stages": 3}, {"scheme": "implicit_euler"}


@pytest.mark.parametrize("scheme", [RADAU_3, RADAU_2, GAUSS_2, LOBATTO_3, EULER], ids=lambda s: s["scheme"])
@pytest.mark.parametrize("name", ["integrator", "unstable_regulator", "steepest_descent", "by_parts"])
def test_the_estimate_is_within_a_factor_of_ten_on_three_meshes(name: str, scheme: dict[str, Any]) -> None:
    problem = SHARED[name]
    for elements in (2, 3, 5):
        assert 0.1 < ratio(problem.build(elements=elements, **scheme), problem.exact) < 10.0


@pytest.mark.parametrize("elements", [5, 10, 20])
def test_a_bound_of_a_state_between_the_points_counts(elements: int) -> None:
    assert 0.1 < ratio(phases.bryson_denham(elements=elements), 4.0) < 10.0


def with_force(elements: int, **scheme: Any) -> Any:
    """The integrator, its control the cube of an algebraic variable in part."""
    m, b = one_phase(model="with force", duration=3.0, elements=elements, **scheme)
    b.x, b.u, b.force = rcp.State(initial=1), rcp.Control(), rcp.Algebraic()
    b.ode(lambda b, t: {b.x: b.force[t]})
    b.residual(lambda b, t: b.force[t] + 0.3 * b.force[t] ** 3 == b.u[t])
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2))
    return m


@pytest.mark.parametrize(("build", "meshes"), [(SHARED["mixed_limit"].build, (5, 10)), (with_force, (1, 2, 4))])
@pytest.mark.parametrize("scheme", [RADAU_3, GAUSS_2], ids=lambda s: s["scheme"])
def test_rows_that_controls_can_meet_restrain_them_between_the_points(
    build: Builder, meshes: tuple[int, ...], scheme: dict[str, Any]
) -> None:
    exact = rcp.solve(build(elements=40, scheme="radau", stages=4)).objective
    for elements in meshes:
        assert 0.5 < ratio(build(elements=elements, **scheme), exact) < 2.0


def test_errors_with_different_signs_cancel() -> None:
    """A motion that is symmetric in time: implicit Euler is too late on one half, too early on the other."""
    result = rcp.solve(phases.bryson_denham(elements=20, **EULER))
    found = result.discretisation
    (phase,) = found.phases.values()
    assert phase.net is not None
    assert abs(phase.net) < 0.6 * phase.objective.sum()
    assert 0.2 * phase.objective.sum() <= found.objective_error < phase.objective.sum()
    assert 0.2 < found.objective_error / abs(result.objective - 4.0) < 4.0


def test_the_estimate_becomes_exact_on_finer_meshes() -> None:
    assert ratio(integrator(8), tanh(3.0)) == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize("elements", [1, 3])
def test_to_maximise_the_negative_is_the_same_problem(elements: int) -> None:
    lower, upper = (rcp.solve(integrator(elements, sense)).discretisation for sense in (pyo.minimize, pyo.maximize))
    assert lower.objective_error == pytest.approx(upper.objective_error, rel=1e-6)


def test_units_of_the_objective_and_the_time_change_nothing() -> None:
    def stretched(factor: float) -> Any:
        m, b = one_phase(duration=3.0 * factor, elements=3, x=rcp.State(initial=1), u=rcp.Control())
        b.ode(lambda b, t: {b.x: b.u[t] / factor})
        m.cost = pyo.Objective(expr=1000 * b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2) / factor)
        return m

    found = [rcp.solve(stretched(factor)).discretisation.relative_objective_error for factor in (1.0, 60.0)]
    assert found[0] == pytest.approx(found[1], rel=1e-4)


def test_a_cost_that_the_quadrature_misses_is_said_in_the_first_line() -> None:
    # Twenty elements: 4.79 in place of 5.068, from a control that swings between the points of one element. Its
    # motion is exact.
    m = SHARED["hanging_chain"].build(elements=20)
    result = rcp.solve(m, mesh_tolerance=None)
    verdict = m.p.trajectory().verify()
    assert verdict.element_error < 1e-9
    assert verdict.integral_error is not None
    assert verdict.integral_error > 0.1
    assert result.discretisation.is_large
    assert "COARSE MESH" in str(result)
    assert "The mesh is coarse: take more elements" in result.report()


def test_an_estimate_is_of_the_answer_whatever_becomes_of_the_model() -> None:
    models = [integrator(3) for _ in range(2)]
    untouched, moved = (rcp.solve(model) for model in models)
    models[1].p.remesh(7)
    models[1].p.x[0.0].fix(5.0)
    assert moved.discretisation.objective_error == pytest.approx(untouched.discretisation.objective_error, rel=1e-9)


def test_a_pickle_keeps_the_estimate() -> None:
    result = rcp.solve(integrator(3))
    again = pickle.loads(pickle.dumps(result))
    assert again.discretisation.objective_error == result.discretisation.objective_error


def following(reference: Any, elements: int = 6, **vector: Any) -> Any:
    """A state that follows a reference; for vectors each component."""
    m, b = phases.integrator(x={"initial": 0, **vector}, u=vector, duration=3.0, elements=elements)
    m.cost = pyo.Objective(
        expr=b.integral(lambda b, t: sum(np.ravel((b.x[t] - reference(t)) ** 2)) + 0.05 * sum(np.ravel(b.u[t] ** 2)))
    )
    return m


TIMES = np.linspace(0, 3, 31)


@pytest.mark.parametrize(
    ("reference", "vector"),
    [
        (lambda t: pyo.sin(4 * t), {}),
        (lambda t: 1.0, {}),
        (rcp.Table(TIMES, np.sin(4 * TIMES)), {}),
        (lambda t: [rcp.Table(TIMES, np.sin(4 * TIMES))(t), t], {"index": 2}),
    ],
)
def test_what_follows_a_reference_has_an_estimate(reference: Any, vector: dict[str, Any]) -> None:
    exact = rcp.solve(following(reference, 60, **vector)).objective
    assert 0.1 < ratio(following(reference, **vector), exact) < 10.0


@pytest.mark.parametrize("limit", [1.22, 1.24, 1.26])
@pytest.mark.parametrize("scheme", [RADAU_2, RADAU_3, GAUSS_2], ids=lambda s: f"{s['scheme']} {s['stages']}")
def test_a_limit_that_is_left_inside_an_element_counts(limit: float, scheme: dict[str, Any]) -> None:
    """On a mesh that is coarse there the motion stays at its limit until the boundary, and has a kink."""
    mesh = [0, 0.25, 0.27, 0.29, 0.31, 0.44, 0.5, 0.75, 1]
    m, b = mass(x={"initial": 0, "final": 1}, v={"initial": 0, "final": 0}, duration=1.0, mesh=mesh, **scheme)
    b.constraint(lambda b, t: b.v[t] <= limit)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    result = rcp.solve(m, mesh_tolerance=None)
    off = abs(result.objective - 16 * limit**2 / (9 * (1 - 1 / limit)))
    assert off <= max(1e-3 * result.objective, 10 * result.discretisation.objective_error)


def test_a_bound_that_is_passed_flatters_the_objective_by_its_multiplier() -> None:
    """The mesh of two switches, one of them beside where it has to be: the polynomials err, and in no net sum."""
    mesh = [0, 0.1, 0.2, 0.2395, 0.3, 0.4, 0.5, 0.6, 0.7, 0.7143, 0.8, 0.9, 1]
    duration = rcp.Duration(bounds=(0.1, 20), initial_guess=5)
    m = phases.rest_to_rest(10.0, v={"bounds": (None, 2)}, duration=duration, mesh=mesh)  # takes seven seconds
    result = rcp.solve(m, mesh_tolerance=None)
    (phase,) = result.discretisation.phases.values()
    assert result.objective < 7.0 - 1e-3
    assert 0.1 < phase.passed / (7.0 - result.objective) < 10.0
    assert phase.passed <= result.discretisation.objective_error


def test_a_path_constraint_of_states_counts_as_the_bound_that_it_is() -> None:
    def as_row(elements: int) -> Any:
        m = phases.bryson_denham(elements=elements)
        m.p.x.setub(None)
        m.p.constraint(lambda b, t: b.x[t] <= 1 / 9)
        return m

    models = (phases.bryson_denham(elements=5), as_row(5))
    errors = [rcp.solve(model, mesh_tolerance=None).discretisation for model in models]
    bound, row = ([phase.passed for phase in found.phases.values()] for found in errors)
    assert bound == pytest.approx(row, rel=1e-3)
    assert bound[0] > 1e-3


def test_what_is_passed_is_each_multiplier_times_the_mean_excess_beside_its_point() -> None:
    m = phases.bryson_denham(elements=5)
    m.p.x.setub(None)

    m.p.constraint(lambda b, t: b.x[t] <= 1 / 9, name="ceiling")

    m.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    (phase,) = rcp.solve(m, mesh_tolerance=None).discretisation.phases.values()
    points, plan = list(m.p.points), m.p.trajectory()
    gauss = (np.polynomial.legendre.leggauss(8)[0] + 1) / 2
    samples = np.concatenate([(i + gauss) / 5 for i in range(5)])
    excess = np.maximum(plan(samples)["x"] - 1 / 9, 0.0)
    stages = [time for time in points if time > 0]
    gaps = np.searchsorted(stages, samples)
    means = [excess[gaps == k].mean() if (gaps == k).any() else 0.0 for k in range(len(stages) + 1)]
    expected = sum(-m.dual.get(m.p.ceiling[t], 0.0) * max(means[k], means[k + 1]) for k, t in enumerate(stages))
    assert phase.passed == pytest.approx(expected, rel=1e-6)


def nose_cone(elements: int) -> Any:
    """Newton's body of least resistance, as long as its base is wide: flat in front, then steep at once."""
    m, b = one_phase(model="nose cone", duration=1.0, elements=elements)
    b.y = rcp.State(initial=1, final=0, initial_guess=lambda t: 1 - t)
    b.u = rcp.Control(bounds=(0, None), initial_guess=1)
    b.ode(lambda b, t: {b.y: -b.u[t]})
    m.drag = pyo.Objective(expr=b.integral(lambda b, t: 2 * t / (1 + b.u[t] ** 2)))
    return m


@pytest.mark.parametrize("elements", [10, 20, 40])
def test_a_valley_that_the_control_left_too_late_is_seen_from_the_other_one(elements: int) -> None:
    assert 0.1 < ratio(nose_cone(elements), 0.374815987628) < 10.0  # its exact solution, Bryson & Ho, sec. 3.3


def test_what_cannot_be_estimated_is_said_with_its_reason() -> None:
    m = following(lambda t: 1.0)
    b = m.p
    m.cost.expr += b.integral(lambda b, t: b.x[t] ** 2 * b.points.ord(t))  # a place that no other time has
    found = rcp.solve(m).discretisation
    assert found.objective_error is None
    assert any("its integrand '<lambda>'" in remark for remark in found.remarks)
    assert "objective not known" in found.sentence()


def test_modes_of_which_one_holds_leave_the_errors_known(caplog: pytest.LogCaptureFixture) -> None:
    m, b = one_phase(model="modes", duration=1.0, elements=5, x=rcp.State(initial=1.0))
    b.mode = rcp.Control(index=["up", "down"], integer=(0, 1), one_of=True, initial_guess=0.5)
    b.ode(lambda b, t: {b.x: b.mode["up", t] * b.x[t] - b.mode["down", t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.x[t] - 0.5) ** 2))
    found = rcp.solve(m).discretisation
    assert found.objective_error is not None
    assert found.motion_error is not None
    assert "ERROR" not in caplog.text


@pytest.mark.parametrize(("objective", "words"), [(8.0, "1 %"), (1e-9, "8.0e-02 in its units, where the objective is")])
def test_the_error_of_an_objective_that_is_zero_is_no_part_of_it(objective: float, words: str) -> None:
    phase = PhaseEstimate("p", np.zeros(2), "x", 0.0, np.full(2, 0.04), net=0.08)
    estimate = DiscretisationEstimate(objective, {"p": phase}, size=size_of_objective(objective, None))
    for text in (estimate.in_short(), estimate.sentence()):
        assert words in text


def test_a_model_without_phases_has_nothing_to_say() -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=1.0)
    m.cost = pyo.Objective(expr=(m.x - 2) ** 2)
    result = rcp.solve(m)
    assert result.discretisation.sentence() == ""
    assert not result.discretisation.is_large
    assert "error of the mesh" not in result.report()


@pytest.mark.parametrize("elements", [2, 4, 8])
def test_integrals_along_the_motion_are_integrated_to_ten_digits(elements: int) -> None:
    m, b = one_phase(duration=1.0, elements=elements, scheme="radau", stages=2)
    b.x, b.u = rcp.State(initial=1), rcp.Control(bounds=(0, 0))
    b.ode(lambda b, t: {b.x: b.x[t] + b.u[t]})
    m.area = pyo.Objective(expr=b.integral(lambda b, t: pyo.cosh(b.x[t])))
    rcp.solve(m, mesh_tolerance=None)
    found = m.p.reintegrate()
    ((planned, moved),) = found.integrals.values()
    assert planned.sum() == pytest.approx(pyo.value(m.area), rel=1e-12)
    starts, times = m.p.trajectory().element_states("x")[:, 0], np.linspace(0, 1 / elements, 4001)
    exact = [np.trapezoid(np.cosh(start * np.exp(times)), times) for start in starts]
    np.testing.assert_allclose(moved, exact, rtol=1e-7)
    assert cosh(1.0) < moved.sum() < cosh(exp(1.0))


# --------------------------------------------------------------------
# Errors are not known of rules that compute with the time as a number; of earlier times and tables they are.


# What was asked at the points of the mesh while it was built: 0 or another problem is seen between them.
BY_POINT: dict[str, Any] = {
    "a function of Python": (lambda b, t: cos(3 * t), {}),
    "a pulse": (lambda b, t: 40.0 if 0.4 < t < 0.41 else 0.0, {}),
    "a dictionary": (lambda b, t: {0.0: 1.0}.get(t, 0.0), {}),
    "samples": (lambda b, t: float(np.interp(t, [0, 2], [0, 1])), {}),
    "bounds that jump": (lambda b, t: 0.0, {"bounds": lambda t: (-9, 1.0 if t < 0.37 else 2.0)}),
}


def driven(rate: Any, control: Any) -> Any:
    m, b = one_phase(model="driven", duration=2.0, elements=4, stages=2)
    b.x, b.u = rcp.State(initial=0, final=1), rcp.Control(**control)
    b.ode(lambda b, t: {b.x: b.u[t] + rate(b, t)}, name="drive")
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m


@pytest.mark.parametrize("name", BY_POINT)
def test_errors_are_not_known_where_a_rule_has_to_know_the_time(name: str) -> None:
    m = driven(*BY_POINT[name])
    result = solution(m)
    found = result.discretisation
    assert (found.objective_error, found.motion_error, found.excess) == (None, None, None)
    (why,) = found.remarks
    rule = "constraint 'u_bounds'" if name == "bounds that jump" else "ode 'drive' (test_estimated_errors.py:"
    assert rule in why
    assert m.p.grid.mesh.elements == 4


def test_a_window_of_rows_has_errors_that_are_not_known() -> None:
    m = driven(lambda b, t: 0.0, {})
    m.p.constraint(lambda b, t: b.u[t] <= 0.2 if 0.7 < t < 1.1 else pyo.Constraint.Skip, name="window")
    found = rcp.solve(m).discretisation
    assert found.objective_error is None
    assert "'window'" in found.remarks[0]


def test_in_symbols_the_same_statements_have_small_errors_and_boundaries_where_they_jump() -> None:
    m = driven(lambda b, t: pyo.Expr_if(pyo.inequality(0.4, t, 0.41), 40.0, 0.0) + pyo.cos(3 * t), {})
    m.p.y = rcp.Algebraic(bounds=lambda t: (-9, pyo.Expr_if(t < 1.37, 1.0, 2.0)))
    m.p.residual(lambda b, t: b.y[t] == b.x[t] / 9)
    result = rcp.solve(m)
    assert result.discretisation.relative_objective_error < 1e-3
    for time in (0.4, 0.41, 1.37):
        assert min(abs(time - boundary) for boundary in m.p.grid.mesh.boundaries) < 1e-9
    # The least effort is constant: x(2) = 1 less what the drive gives.
    assert result.objective == pytest.approx((1 - 0.4 - sin(6) / 3) ** 2 / 2, rel=1e-3)


def test_a_motion_at_the_edge_of_a_table_is_judged() -> None:
    heights = np.linspace(0.0, 2.0, 9)
    drag = rcp.Table(heights, 0.3 + np.exp(-heights), name="drag")
    m, b = one_phase(model="down to the ground", duration=1.0, elements=6, scheme="implicit_euler")
    b.h, b.v = rcp.State(initial=1, final=0, bounds=(0, 2)), rcp.State(initial=-2, final=0)
    b.u = rcp.Control()
    b.ode(lambda b, t: {b.h: b.v[t], b.v: b.u[t] - drag(b.h[t]) * b.v[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    result = solution(m)
    # It slows down, so that a step of implicit Euler falls too little: the motion of the equations is below the ground.
    moved = b.reintegrate(b.trajectory())
    assert min(of["h"].min() for of in (moved.local, moved.open_loop)) < -0.01
    assert result.discretisation.motion_error is not None
    assert result.discretisation.objective_error is not None
    assert np.isfinite(b.trajectory().verify().element_error)
    with pytest.raises(rcp.errors.EvaluationError):
        drag(-0.01)


def delayed(elements: int, *, control: bool = False) -> Any:
    """A state that what it was half a second ago drives away."""
    m, b = one_phase(model="delayed", duration=2.0, elements=elements, stages=2)
    b.x, b.u = rcp.State(initial=1, history=lambda t: 1 + t), rcp.Control(history=0.0)
    b.ode(lambda b, t: {b.x: 2 * b.x.delayed(t, 0.5) ** 2 + (b.u.delayed(t, 0.5) if control else b.u[t])})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2))
    return m


def test_delayed_states_have_errors() -> None:
    exact = rcp.solve(delayed(64)).objective
    for elements in (4, 8):
        m = delayed(elements)
        result, motion = solution(m), m.p.trajectory()
        assert not result.discretisation.remarks
        error = abs(result.objective - exact)
        assert error / 10 <= result.discretisation.objective_error <= 10 * error
        inside = motion.verify().element_error / abs(motion.x).max()  # at the ends of elements and between them
        assert 0.1 * inside < result.discretisation.motion_error < min(1.01 * inside, (0.2, 0.02)[elements == 8])


def test_what_a_delayed_control_does_later_is_not_claimed_to_be_known() -> None:
    found = rcp.solve(delayed(8, control=True)).discretisation
    assert found.objective_error is None
    assert "'u' is read at earlier times" in " ".join(found.remarks)
    assert found.motion_error is not None
