"""Refinement reaches its tolerance with few elements, and says so where it does not."""

from __future__ import annotations

from math import sinh, sqrt
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError, TrajectoryError

pytestmark = pytest.mark.casadi

HORIZON = 50.0


def hypersensitive(mesh: Any = None, cubic: bool = True, **options: Any) -> Any:
    """Layers of width one at both ends of a long, dull horizon."""
    m = pyo.ConcreteModel("layers")
    m.p = b = rcp.PhaseBlock(duration=HORIZON, mesh=mesh, **options)
    b.x = rcp.State(initial=1, final=1.5)
    b.u = rcp.Control()
    b.ode(lambda b, t: {b.x: b.u[t] - (b.x[t] ** 3 if cubic else b.x[t])})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2))
    return m


def uniform_error(elements: int, **options: Any) -> float:
    m = hypersensitive(rcp.schemes.Mesh.uniform(0, HORIZON, elements), **options)
    rcp.solve(m).raise_for_status()
    return float(m.p.trajectory().verify().element_error)


def test_boundary_layers_take_less_than_half_of_the_best_uniform_mesh() -> None:
    refined = rcp.studies.solve_refined(hypersensitive, tolerance=1e-6)
    refined.raise_for_status()
    assert refined.end is rcp.studies.RefinementEnd.REACHED
    verdict = refined.trajectory.verify()
    assert verdict.element_error <= 1e-6 * np.abs(refined.trajectory.x).max()
    assert verdict.largest_violation < 1e-7
    elements = refined.outcomes[-1].elements
    assert elements == refined.trajectory.grid.mesh.elements < 60
    assert uniform_error(2 * elements) > 1e-6
    np.testing.assert_allclose(refined.errors["p"], verdict.element_errors, rtol=1e-6, atol=1e-14)
    assert refined.errors["p"].max() == pytest.approx(verdict.element_error)


@pytest.mark.parametrize("scheme", ["radau", "gauss", "lobatto"])
def test_refined_answers_come_near_the_exact_one(scheme: str) -> None:
    def build(mesh: Any) -> Any:
        return hypersensitive(mesh, cubic=False, scheme=scheme)

    root, distances = sqrt(2), []
    for tolerance in (1e-4, 1e-8):
        refined = rcp.studies.solve_refined(build, tolerance, objective_tolerance=np.inf)
        refined.raise_for_status()
        assert refined.trajectory.verify().element_error <= tolerance * max(1.0, np.abs(refined.trajectory.x).max())
        time = refined.trajectory.time
        exact = [(sinh(root * (HORIZON - t)) + 1.5 * sinh(root * t)) / sinh(root * HORIZON) for t in time]
        distances.append(np.abs(refined.trajectory.x - exact).max())
    assert distances[0] < 0.02
    assert distances[1] < min(1e-4, distances[0] / 30)


def pendulum(mesh: Any) -> Any:
    m = pyo.ConcreteModel("swing-up")
    m.effort_bound = pyo.Var(initialize=1.0)
    m.swing = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(1, 5), initial_guess=2), mesh=mesh)
    b.theta, b.omega = rcp.State(initial=0, final=np.pi), rcp.State(initial=0, final=0)
    b.torque = rcp.Control(bounds=(-6, 6))
    b.ode(lambda b, t: {b.theta: b.omega[t], b.omega: b.torque[t] - 9.81 * pyo.sin(b.theta[t])})
    m.limit = pyo.Constraint(expr=b.integral(lambda b, t: b.torque[t] ** 2) <= m.effort_bound)
    m.cost = pyo.Objective(expr=m.effort_bound + b.duration)
    return m


def test_a_warm_start_takes_no_more_iterations_than_a_cold_one() -> None:
    refined = rcp.studies.solve_refined(pendulum, tolerance=1e-7, elements=12)
    refined.raise_for_status()
    cold = pendulum(refined.model.swing.grid.mesh)
    assert refined.outcomes[-1].iterations <= rcp.solve(cold).iterations
    assert refined.model.effort_bound.value == pytest.approx(refined.result.objective - refined.trajectory.duration)
    assert [step.elements for step in refined.outcomes] == sorted(step.elements for step in refined.outcomes)


def two_phases(meshes: Any) -> Any:
    m = pyo.ConcreteModel("two")
    for name, end in (("slow", 0.1), ("fast", 1.0)):
        b = rcp.PhaseBlock(duration=2.0, mesh=meshes[name], scheme="radau", stages=2)
        m.add_component(name, b)
        b.x, b.u = rcp.State(initial=1), rcp.Control(bounds=(-end, end))
        b.ode(lambda b, t: {b.x: b.u[t] - b.x[t] ** 2})
    m.cost = pyo.Objective(expr=sum(b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2) for b in (m.slow, m.fast)))
    return m


def test_several_phases_are_refined_by_name() -> None:
    refined = rcp.studies.solve_refined(two_phases, 1e-7, phases=["slow", "fast"], elements={"slow": 3}, mesh=None)
    refined.raise_for_status()
    assert set(refined.errors) == set(refined.trajectories) == {"slow", "fast"}
    for trajectory in refined.trajectories.values():
        assert trajectory.verify().element_error <= 1e-7
    with pytest.raises(TrajectoryError, match=r"refined were slow, fast: read trajectories\['slow'\]"):
        _ = refined.trajectory
    assert refined.outcomes[0].elements == 13


def implicit(mesh: Any) -> Any:
    m = pyo.ConcreteModel("implicit")
    m.p = b = rcp.PhaseBlock(duration=4.0, mesh=mesh, stages=2)
    b.x, b.v = rcp.State(initial=1), rcp.State(initial=0)
    b.force, b.u = rcp.Algebraic(), rcp.Control(bounds=(-0.1, 0.1))
    b.ode(lambda b, t: {b.x: b.v[t]})
    b.residual(newton)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2))
    return m


def newton(b: Any, t: float) -> Any:
    return [b.derivative(b.v)[t] == b.force[t] + b.u[t], b.force[t] == -5 * pyo.sin(b.x[t])]


def explicit(mesh: Any) -> Any:
    m = pyo.ConcreteModel("explicit")
    m.p = b = rcp.PhaseBlock(duration=4.0, mesh=mesh, stages=2)
    b.x, b.v, b.u = rcp.State(), rcp.State(), rcp.Control()
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - 5 * pyo.sin(b.x[t])})
    return m


def test_implicit_equations_are_judged_like_the_explicit_ones() -> None:
    refined = rcp.studies.solve_refined(implicit, 1e-5, elements=8)
    refined.raise_for_status()
    same = explicit(refined.trajectory.grid.mesh)
    same.p.initialize(refined.trajectory)
    np.testing.assert_allclose(same.p.element_errors(), refined.errors["p"], rtol=1e-2, atol=1e-9)


def test_limits_end_with_what_was_found() -> None:
    refined = rcp.studies.solve_refined(hypersensitive, 1e-6, most_meshes=2)
    assert (refined.end, len(refined.outcomes), refined.reached) == (rcp.studies.RefinementEnd.MESH_LIMIT, 2, False)
    with pytest.raises(rcp.errors.SolveFailed, match=r"'layers': The limit of meshes .* Mesh 2 has .* asked was 1e-06"):
        refined.raise_for_status()
    refined = rcp.studies.solve_refined(hypersensitive, 1e-6, most_elements=15)
    assert refined.end is rcp.studies.RefinementEnd.ELEMENT_LIMIT
    assert refined.outcomes[-1].elements <= 15
    refined = rcp.studies.solve_refined(hypersensitive, 1e-6, options={"max_iter": 1})
    assert refined.end in (rcp.studies.RefinementEnd.FAILED, rcp.studies.RefinementEnd.REACHED)
    refined = rcp.studies.solve_refined(infeasible)
    assert refined.end is rcp.studies.RefinementEnd.FAILED
    assert refined.errors == {}
    assert np.isnan(refined.outcomes[-1].element_error)


def infeasible(mesh: Any) -> Any:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(mesh=mesh)
    b.x, b.u = rcp.State(initial=0, final=2), rcp.Control(bounds=(-1, 1))
    b.ode(lambda b, t: {b.x: b.u[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m


def test_the_table_prints_and_is_a_frame(capsys: Any) -> None:
    pytest.importorskip("pandas")
    refined = rcp.studies.solve_refined(hypersensitive, 1e-2, progress=True)
    shown = capsys.readouterr().err
    lines = str(refined).splitlines()
    assert lines[0] == (
        "layers: Every element's error is within the tolerance. Asked was 0.01, and 0.0001 of the objective."
    )
    columns = [
        "mesh",
        "elements",
        "error",
        "of",
        "cost",
        "objective",
        "quality",
        "certificate",
        "iter",
        "seconds",
        "reason",
    ]
    assert lines[1].split() == columns
    assert len(lines) == 2 + len(refined.outcomes)
    assert all(line in " ".join(shown.split()) for line in [" ".join(line.split()) for line in lines[1:]])
    frame = refined.to_pandas()
    assert list(frame["elements"]) == [step.elements for step in refined.outcomes]
    assert frame.index.name == "mesh"
    assert refined.iterations == frame["iterations"].sum()
    assert refined.seconds == pytest.approx(frame["seconds"].sum())


def no_phase(mesh: Any) -> Any:
    return pyo.ConcreteModel("empty")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        ({"build": no_phase}, r"a model with 0 phases: none\. Pass phases"),
        ({"build": lambda mesh: two_phases({"slow": None, "fast": None})}, "with 2 phases: slow, fast"),
        ({"build": lambda mesh: None}, "returned a NoneType; expected a model. Is 'return m' missing"),
        (
            {"build": lambda mesh: hypersensitive(), "elements": 7},
            "'p' with 10 elements; .* has 7. Pass it on",
        ),
        ({"phases": "p"}, r"phases = 'p'; expected a list of names, such as \['p'\]"),
        ({"build": lambda meshes: hypersensitive(), "phases": ["q"]}, "model 'layers', which has no phase 'q'"),
        ({"elements": {"q": 3}}, "a first mesh for 'q'; refined are p"),
        ({"elements": 3, "mesh": [0, 50]}, "elements and mesh are given"),
        ({"tolerance": 0}, "tolerance = 0; expected a positive number"),
        ({"tolerance": "small"}, "tolerance = 'small'; expected"),
        ({"most_parts": 1}, "at least 1 and 2 are needed"),
    ],
)
def test_what_does_not_fit_is_refused(call: dict[str, Any], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        rcp.studies.solve_refined(**{"build": hypersensitive, **call})


def test_errors_that_cannot_be_estimated_are_explained() -> None:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(elements=2)
    b.u = rcp.Control()
    with pytest.raises(TrajectoryError, match="has no states: there is no error to estimate"):
        b.element_errors()
    b.x, b.f, b.g = rcp.State(), rcp.Algebraic(), rcp.Algebraic()
    b.ode(lambda b, t: {})
    b.residual(half)
    with pytest.raises(TrajectoryError, match="determine neither all algebraics nor the derivatives alone"):
        b.element_errors()


def half(b: Any, t: float) -> Any:
    return [b.derivative(b.x)[t] == b.u[t], b.f[t] == b.g[t]]


def stop_in_minimum_time(mesh: Any) -> Any:
    """Faster up than down: the switch is after a third of the square root of three."""
    m = pyo.ConcreteModel("fastest move")
    m.p = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 10), initial_guess=2), mesh=mesh)
    b.x, b.v = rcp.State(initial=0, final=1), rcp.State(initial=0, final=0)
    b.u = rcp.Control(bounds=(-1, 2))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
    m.cost = pyo.Objective(expr=b.duration)
    return m


def test_a_boundary_moves_to_where_a_control_switches() -> None:
    refined = rcp.studies.solve_refined(stop_in_minimum_time, elements=4, objective_tolerance=1e-12, most_meshes=2)
    assert abs(np.array(refined.trajectory.grid.mesh.boundaries) - 3**0.5 / 3).min() < 1e-5
    assert refined.result.objective == pytest.approx(3**0.5, rel=1e-6)
    assert refined.outcomes[0].objective < 3**0.5 - 1e-3


def test_a_tolerance_beyond_the_accuracy_of_the_solver_ends_with_what_it_gives() -> None:
    refined = rcp.studies.solve_refined(
        stop_in_minimum_time, elements=3, objective_tolerance=1e-14, most_elements=300, join=False
    )
    assert not refined.reached
    assert refined.end in (rcp.studies.RefinementEnd.STALLED, rcp.studies.RefinementEnd.ELEMENT_LIMIT)
    assert refined.result.objective == pytest.approx(3**0.5, rel=1e-5)


def follows_a_reference(mesh: Any, cost: str) -> Any:
    """A state that cannot keep up with its reference, so that its control jumps."""
    m = pyo.ConcreteModel("follower")
    m.p = b = rcp.PhaseBlock(duration=5.0, mesh=mesh)
    b.x, b.u = rcp.State(initial=0), rcp.Control(bounds=(-1, 1))
    b.ode(lambda b, t: {b.x: b.u[t]})
    by_hand = b.integral(lambda b, t: (b.x[t] - 5 * pyo.sin(3 * t)) ** 2)
    m.cost = pyo.Objective(expr=b.tracking("x", lambda t: 5 * pyo.sin(3 * t)) if cost == "tracking" else by_hand)
    return m


def test_a_tracking_cost_is_refined_as_the_integral_that_it_is() -> None:
    found = [
        rcp.studies.solve_refined(lambda mesh, cost=cost: follows_a_reference(mesh, cost), elements=5, most_meshes=4)
        for cost in ("tracking", "integral")
    ]
    first, second = ([(step.elements, step.objective_error) for step in refined.outcomes] for refined in found)
    assert len(first) > 1
    assert first == [(elements, pytest.approx(error, rel=1e-3)) for elements, error in second]


def limited_speed(mesh: Any, as_row: bool = False) -> Any:
    """From rest to rest in the shortest time, below a speed of two: ten metres in seven seconds."""
    m = pyo.ConcreteModel("limited speed")
    m.p = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 20), initial_guess=5), mesh=mesh)
    b.x = rcp.State(initial=0, final=10)
    b.v = rcp.State(initial=0, final=0, bounds=(None, None if as_row else 2))
    b.u = rcp.Control(bounds=(-1, 1))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
    if as_row:
        b.constraint(lambda b, t: b.v[t] <= 2)
    m.cost = pyo.Objective(expr=b.duration)
    return m


@pytest.mark.parametrize("as_row", [False, True])
def test_a_limit_of_a_state_is_met_between_the_points_too(as_row: bool) -> None:
    refined = rcp.studies.solve_refined(lambda mesh: limited_speed(mesh, as_row), 1e-4)
    assert refined.reached
    trajectory = refined.trajectory
    fine = trajectory(np.linspace(0, trajectory.duration, 5001))
    assert fine["v"].max() < 2 * (1 + 2e-4)
    assert refined.result.objective == pytest.approx(7.0, rel=1e-4)


def two_oscillators(mesh: Any, duration: float = 4.2) -> Any:
    """Nishida's problem: the smallest distance from the origin at the end, by one control that switches; 1.003475."""
    m = pyo.ConcreteModel("two oscillators")
    m.p = b = rcp.PhaseBlock(duration=duration, mesh=mesh)
    b.x, b.u = rcp.State(index=4, initial=10), rcp.Control(bounds=(-1, 1))

    @b.ode
    def oscillators(b: Any, t: float) -> Any:
        x, u = b.x[t], b.u[t]
        slow = [-0.5 * x[0] + 5 * x[1], -5 * x[0] - 0.5 * x[1] + u]
        return {b.x: [*slow, -0.6 * x[2] + 10 * x[3], -10 * x[2] - 0.6 * x[3] + u]}

    m.cost = pyo.Objective(expr=sum(b.x[i, b.final_time] ** 2 for i in range(4)))
    return m


def test_a_better_objective_of_a_motion_that_is_none_is_not_kept() -> None:
    refined = rcp.studies.solve_refined(two_oscillators, 1e-4, objective_tolerance=1e-3)
    assert refined.outcomes[0].objective < 0.5  # ten elements, whose motion is wrong by a quarter
    assert refined.outcomes[0].element_error > 0.2
    assert refined.reached
    assert refined.result.objective == pytest.approx(1.003475, rel=2e-3)


def pushed_by_a_pair(mesh: Any) -> Any:
    m = pyo.ConcreteModel("pair")
    m.p = b = rcp.PhaseBlock(duration=2.0, mesh=mesh, scheme="implicit_euler")
    b.x, b.u, b.up, b.down = rcp.State(initial=1), rcp.Control(), *(rcp.Algebraic(bounds=(0, None)) for _ in range(2))
    b.ode(lambda b, t: {b.x: b.up[t] - b.down[t]})
    b.complementarity(lambda b, t: rcp.complements(b.up[t], b.down[t]))
    b.residual(lambda b, t: b.u[t] == b.up[t] - b.down[t])
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2))
    return m


def test_what_is_not_known_is_not_reached() -> None:
    refined = rcp.studies.solve_refined(pushed_by_a_pair, 0.1, elements=10)
    assert refined.end is rcp.studies.RefinementEnd.UNKNOWN
    assert not refined.reached
    assert "phase 'p': error of the objective not estimated. It has pairs" in str(refined)
    with pytest.raises(rcp.errors.SolveFailed, match="not all of them are known.*It has pairs"):
        refined.raise_for_status()
    without = rcp.studies.solve_refined(pushed_by_a_pair, 0.1, elements=10, objective_tolerance=np.inf)
    assert without.end is rcp.studies.RefinementEnd.REACHED


def linked(meshes: Any) -> Any:
    """One motion in two phases, of which the function takes the mesh of the first."""
    m = pyo.ConcreteModel("linked")
    m.a = rcp.PhaseBlock(duration=1.5, mesh=meshes["a"])
    m.b = rcp.PhaseBlock(duration=1.5, elements=1)
    for b in (m.a, m.b):
        b.x, b.u = rcp.State(), rcp.Control()
        b.ode(lambda b, t: {b.x: b.u[t]})
    m.a.x[0].fix(1.0)
    m.link = rcp.Link(m.a, m.b)
    m.cost = pyo.Objective(
        expr=sum(b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2 + pyo.sin(5 * t) * b.u[t]) for b in (m.a, m.b))
    )
    return m


def test_phases_that_are_not_named_get_better_meshes_too() -> None:
    refined = rcp.studies.solve_refined(linked, phases=["a"])
    assert refined.reached
    assert refined.model.b.grid.mesh.elements > 1
    fine = linked({"a": rcp.schemes.Mesh.uniform(0, 1.5, 30)})
    fine.b.remesh(30)
    assert refined.result.objective == pytest.approx(rcp.solve(fine).objective, rel=1e-4)
