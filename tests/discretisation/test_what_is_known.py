"""What is said of the error of the mesh, wherever a result shows: a number that was computed, or why there is none."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import one_phase
from harness.scenes import keep_clear
from pyomo.dae import ContinuousSet, DerivativeVar

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.phases.variables import add_generated_rows
from pyrobocop_pyomo.presentation import percent
from pyrobocop_pyomo.studies.outcomes import Outcome
from pyrobocop_pyomo.studies.sweep_cases import SweepCase

pytestmark = pytest.mark.ipopt


def shown(result: Any) -> list[str]:
    """All places where a result is shown in short."""
    outcome = Outcome.of(SweepCase(0, "alone", None), result)
    return [
        str(result).splitlines()[0],
        repr(result),
        result._repr_html_(),
        result.one_line(),
        repr(outcome),
        outcome.reason,
    ]


def decay(through_algebraic: bool) -> Any:
    """x' = -20 x**2 from 1: after a time h, x / (1 + 20 h x)."""
    m = pyo.ConcreteModel("decay")
    m.fixed = pyo.Var(initialize=3.0)
    m.fixed.fix()
    m.p = b = rcp.PhaseBlock(duration=1.0, elements=2)
    b.x = rcp.State(initial=1)
    if through_algebraic:
        b.y = rcp.Algebraic(initial_guess=-1)
        b.ode(lambda b, t: {b.x: b.y[t]})
        b.residual(lambda b, t: b.y[t] == -20 * b.x[t] ** 2)
    else:
        b.ode(lambda b, t: {b.x: -20 * b.x[t] ** 2})
    return m


@pytest.mark.parametrize("through_algebraic", [False, True])
@pytest.mark.parametrize("objective", [None, lambda m: 5.0, lambda m: 2 * m.fixed], ids=["none", "constant", "fixed"])
def test_where_nothing_is_minimised_the_error_is_that_of_the_motion(objective: Any, through_algebraic: bool) -> None:
    m = decay(through_algebraic)
    if objective is not None:
        m.cost = pyo.Objective(expr=objective(m))
    result = rcp.solve(m, mesh_tolerance=None, progress=False)
    x = [m.p.x[t].value for t in (0.0, 0.5, 1.0)]
    exact = max(abs(after - before / (1 + 10 * before)) for before, after in pairwise(x))
    assert result.discretisation.motion_error == pytest.approx(exact, rel=3e-2)
    assert result.discretisation.objective_error == 0.0
    assert f"mesh error {percent(result.discretisation.motion_error)} on 2 elements" in str(result)
    assert exact > 1e-2
    assert all("COARSE MESH" in text for text in (str(result), *shown(result)[1:]))


def integrator(elements: int | None = 4, mesh: Any = None, **control: Any) -> Any:
    m, b = one_phase(model="integrator", duration=2.0, elements=elements, mesh=mesh)
    b.x, b.y, b.u, b.w = rcp.State(initial=0), rcp.State(initial=0), rcp.Control(**control), rcp.Control()
    b.ode(lambda b, t: {b.x: b.u[t], b.y: b.w[t]})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: (b.x[t] - 1) ** 2 + b.y[t] ** 2 + b.u[t] ** 2 + b.w[t] ** 2))
    return m


def beside_an_obstacle(way: float) -> Any:
    m = integrator()
    b = m.p
    b.x[2.0].fix(4.0)
    b.y[0.0].fix(way)
    b.y[2.0].fix(way)
    b.initialize(x=lambda t: 2 * t, y=lambda t: way + 1 - abs(t - 1))
    wall = {"wall": rcp.Polytope.box(1, 1, center=(2, 0))}
    body = rcp.Polytope.box(0.4, 0.4)
    keep_clear(b, body, wall, clearance=0.1)
    return m


def with_rows_at_points(bound: float) -> Any:
    m = integrator()
    m.ceiling = pyo.Constraint(m.p.points, rule=lambda m, t: m.p.x[t] <= bound)
    return m


def with_a_sum_over_points() -> Any:
    m = integrator()
    m.effort.set_value(m.effort.expr + 0.1 * sum(m.p.u[t] ** 2 for t in m.p.points))
    return m


def with_data_at_boundaries(elements: int | None = 4, mesh: Any = None) -> Any:
    m = integrator(elements, mesh)
    m.effort.set_value(m.effort.expr + sum((m.p.x[t] - t) ** 2 for t in (0.5, 1.0, 1.5, 2.0)))
    return m


def test_step_maps_beside_a_phase_leave_its_error_known() -> None:
    m = integrator()
    m.counted = b = rcp.PhaseBlock(duration=2.0, elements=4, scheme="implicit_euler")
    b.n, b.u = rcp.State(initial=0.0), rcp.Control(bounds=(0, 1), initial_guess=0.5)
    b.step_map(lambda b, t, previous: {b.n: previous.n + b.u[t]})
    m.effort.set_value(m.effort.expr + (b.n[b.final_time] - 5) ** 2)
    estimate = rcp.solve(m, mesh_tolerance=None, progress=False).discretisation
    assert estimate.phases["p"].objective is not None
    assert estimate.phases["counted"].objective is None


def with_slack_at_points(bound: float) -> Any:
    m = integrator()
    m.slack = pyo.Var(m.p.points, bounds=(0, None))
    m.soft = pyo.Constraint(m.p.points, rule=lambda m, t: m.p.x[t] <= bound + m.slack[t])
    m.effort.set_value(m.effort.expr + sum(m.slack[t] for t in m.p.points))
    return m


def with_bounds_of_a_derivative() -> Any:
    m, b = one_phase(model="bounded derivative", duration=2.0, elements=4)
    b.x, b.u = rcp.State(initial=0, final=1, derivative_bounds=(None, 0.6)), rcp.Control()
    b.ode(lambda b, t: {b.x: b.u[t] - b.x[t]})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m


def with_generated_rows_of_a_new_kind() -> Any:
    m = integrator()
    rows = [(t, m.p.x[t] <= 0.1) for t in m.p.points]
    add_generated_rows(m.p, "x_limit", m.p.points, rows)
    return m


def with_a_waypoint(time: float) -> Any:
    m = integrator()
    m.by = pyo.Constraint(expr=m.p.x.at(time) == 0.2)
    return m


@pytest.mark.parametrize(
    ("build", "name"),
    [
        (lambda: beside_an_obstacle(0.2), "'p.avoid'"),
        (lambda: with_rows_at_points(0.1), "'ceiling'"),
        (lambda: integrator(rate_bounds=(-0.1, 0.1)), "'p.u_rate'"),
        (with_a_sum_over_points, "'effort'"),
        (with_data_at_boundaries, "'effort'"),
        (lambda: with_a_waypoint(0.3), "t = 0.3, inside of elements"),
        (lambda: with_slack_at_points(0.1), "'soft'"),
        (with_bounds_of_a_derivative, "the derivative of 'x'"),
        (with_generated_rows_of_a_new_kind, "'p.x_limit'"),
    ],
)
def test_what_is_stated_at_points_beside_the_phase_leaves_the_error_unknown(
    build: Callable[[], Any], name: str
) -> None:
    result = rcp.solve(build(), mesh_tolerance=None, progress=False)
    assert result.discretisation.objective_error is None
    assert name in str(result).splitlines()[0]
    assert all("mesh error not known" in text for text in shown(result))  # a repr may be cut behind it


@pytest.mark.parametrize(
    "build",
    [
        integrator,
        lambda: with_data_at_boundaries(elements=None, mesh=[0, 0.5, 1, 1.5, 2]),
        lambda: beside_an_obstacle(4.0),
        lambda: with_rows_at_points(5.0),
        lambda: integrator(rate_bounds=(-50, 50)),
        lambda: with_a_waypoint(0.5),
    ],
)
def test_what_restrains_nothing_and_a_waypoint_at_a_boundary_leave_it_known(build: Callable[[], Any]) -> None:
    coarse, fine = build(), build()
    result = rcp.solve(coarse, mesh_tolerance=None, progress=False)
    fine.p.remesh(32) if not hasattr(fine.p, "avoid") and not hasattr(fine, "ceiling") else None
    exact = rcp.solve(fine, mesh_tolerance=None, progress=False)
    error = result.discretisation.objective_error
    assert error is not None
    assert error > 0.3 * abs(result.objective - exact.objective)
    assert not any("not known" in text for text in shown(result))


def with_pyomo_dae(transformation: str, **options: Any) -> Any:
    m = pyo.ConcreteModel("dae")
    m.t = ContinuousSet(bounds=(0, 1))
    m.x, m.u = pyo.Var(m.t, initialize=0.5), pyo.Var(m.t, bounds=(0, 1), initialize=0.5)
    m.dx = DerivativeVar(m.x)
    m.ode = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] == -20 * m.x[t] ** 2 + m.u[t])
    m.x[0].fix(1)
    m.cost = pyo.Objective(expr=(m.x[1] - 0.2) ** 2)
    pyo.TransformationFactory(transformation).apply_to(m, **options)
    return m


@pytest.mark.parametrize(
    ("transformation", "options"),
    [
        ("dae.finite_difference", {"nfe": 2, "scheme": "BACKWARD"}),
        ("dae.collocation", {"nfe": 2, "ncp": 2}),
        ("pyrobocop.collocation", {"nfe": 2}),
    ],
)
def test_a_model_of_pyomo_dae_has_no_estimate_and_says_what_helps(transformation: str, options: Any) -> None:
    m = with_pyomo_dae(transformation, **options)
    result = rcp.solve(m, progress=False)
    assert all("mesh error not known: " in text for text in shown(result))
    assert "'t'" in str(result)
    assert "twice as many" in str(result)
    answer = pyo.SolverFactory("pyrobocop.mpcc").solve(m)
    assert "mesh error not known: " in answer.solver.message
    if transformation == "pyrobocop.collocation":
        with pytest.raises(TrajectoryError, match="read along a ContinuousSet"):
            rcp.dae_trajectory(m, m.t).verify()


@pytest.mark.parametrize("parametrization", ["piecewise_constant", "piecewise_linear"])
def test_values_between_knots_that_a_user_has_placed_are_no_error_of_the_mesh(parametrization: str) -> None:
    objectives = []
    for elements in (2, 4, 8):
        m = integrator(elements, parametrization=parametrization, knots=(0, 1, 2))
        m.p.w.fix(0.0)
        result = rcp.solve(m, mesh_tolerance=None, progress=False)
        objectives.append(result.objective)
        assert result.discretisation.relative_objective_error < 1e-6
    assert np.ptp(objectives) < 1e-7


@pytest.mark.parametrize(("stages", "order", "of_costs"), [(3, 4, 4), (4, 4, 2)])
def test_costs_by_chebyshev_points_converge_with_their_order(stages: int, order: int, of_costs: int) -> None:
    points = (1 - np.cos((2 * np.arange(stages) + 1) * np.pi / (2 * stages))) / 2
    scheme = rcp.schemes.Scheme.from_points("chebyshev", points)

    def solved(elements: int, scheme: Any) -> Any:
        m, b = one_phase(duration=3.0, elements=elements, scheme=scheme, x=rcp.State(initial=1), u=rcp.Control())
        b.ode(lambda b, t: {b.x: b.u[t] * (1 + 0.3 * b.x[t])})
        m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2))
        return rcp.solve(m, mesh_tolerance=None, progress=False)

    exact = solved(40, rcp.schemes.radau(4)).objective
    results = [solved(elements, scheme) for elements in (16, 32)]
    coarse, fine = (abs(result.objective - exact) for result in results)
    assert np.log2(coarse / fine) == pytest.approx(of_costs, abs=0.15)
    assert scheme.order == order


def test_what_is_read_later_is_the_error_of_the_answer_whatever_data_the_model_has_then() -> None:
    def error(*, later: float) -> float:
        m, b = one_phase(duration=2.0, elements=3, x=rcp.State(initial=1), u=rcp.Control())
        m.rate = pyo.Param(initialize=3.0, mutable=True)
        b.ode(lambda b, t: {b.x: b.u[t] - m.rate * b.x[t] ** 2})
        m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2))
        result = rcp.solve(m, mesh_tolerance=None, progress=False)
        m.rate = later
        found = result.discretisation.relative_objective_error
        assert pyo.value(m.rate) == later
        return found

    assert error(later=0.0) == error(later=3.0)
