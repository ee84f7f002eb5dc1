"""`solve` refines a mesh that makes too large an error, and keeps what the model states."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.checked import solution
from harness.phases import bryson_denham, mass, one_phase, rest_to_rest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.discretisation import DiscretisationEstimate
from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.numerics.mesh import halves_of
from pyrobocop_pyomo.planning import mesh_loop

pytestmark = pytest.mark.ipopt


def forced(elements: int = 4, **phase: Any) -> Any:
    """A forcing of four periods, of which so few elements see little."""
    m, b = one_phase(model="forced", duration=4.0, elements=elements, **phase)
    b.x, b.v, b.u = rcp.State(initial=0), rcp.State(initial=0), rcp.Control(bounds=(-5, 5))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] + pyo.sin(6 * t)})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.x[t] - 1) ** 2 + 0.1 * b.u[t] ** 2))
    return m


@pytest.fixture(scope="module")
def exact() -> float:
    found: float = rcp.solve(forced(elements=100), mesh_tolerance=None).objective
    return found


def test_three_digits_are_right_the_result_says_on_which_mesh_and_what_the_user_holds_stays(exact: float) -> None:
    m = forced()
    end = m.p.x[m.p.final_time]
    m.reached = pyo.Constraint(expr=end >= 0.5)  # as it is
    m.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    result = solution(m)
    assert end is m.p.x[m.p.final_time]
    assert all(row.model() is m for row in m.dual)
    assert {row.parent_component().local_name for row in m.dual} >= {"reached", "x_collocation"}
    assert result.objective == pytest.approx(exact, rel=1e-3)
    assert not result.discretisation.is_large
    assert m.p.grid.mesh.elements > 4
    assert any(f"{m.p.grid.mesh.elements} elements" in remark for remark in result.remarks)
    assert result.best.number == len(result.steps) - 1
    assert [step.number for step in result.steps] == list(range(len(result.steps)))


def test_a_smaller_tolerance_gives_a_finer_mesh(exact: float) -> None:
    elements, errors = [], []
    for tolerance in (1e-2, 1e-4, 1e-6):
        m = forced()
        errors.append(abs(rcp.solve(m, mesh_tolerance=tolerance).objective / exact - 1.0))
        elements.append(m.p.grid.mesh.elements)
    assert elements[0] < elements[1] < elements[2]
    assert errors[1] < 1e-4
    assert errors[2] < 1e-6


@pytest.fixture
def same_errors_on_any_mesh(monkeypatch: pytest.MonkeyPatch) -> None:
    """A control may turn by any number of circles from point to point: no mesh makes its polynomials mean more."""
    monkeypatch.setattr(DiscretisationEstimate, "ratio", lambda estimate, tolerance: 5.0)
    monkeypatch.setattr(DiscretisationEstimate, "largest_known_motion_error", 1.0)
    monkeypatch.setattr(
        DiscretisationEstimate, "finer", lambda estimate, meshes, *_, **__: {n: halves_of(m) for n, m in meshes.items()}
    )


@pytest.mark.usefixtures("same_errors_on_any_mesh")
def test_errors_that_a_finer_mesh_does_not_lessen_end_the_loop() -> None:
    result = rcp.solve(forced(elements=20), strategies=rcp.Strategy(exploration=0))
    assert [step.label for step in result.steps] == ["solve", "finer mesh"]


def test_an_objective_of_zero_is_refined_to_a_part_of_its_scale() -> None:
    """A force without limit holds a place at once: each mesh has a cost of zero, which no motion has."""
    m, b = mass(x={"initial": 0}, v={"initial": 0}, duration=2.0, elements=20)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.x[t] - 1) ** 2))
    result = solution(m)
    assert not result.discretisation.is_large
    assert 0.0 < result.discretisation.objective_error < 1e-3
    assert len(result.steps) <= 6
    assert max(map(abs, b.u.get_values().values())) < 1e9


def test_the_mesh_stays_without_tolerance_and_where_it_is_fine_enough() -> None:
    coarse, fine = forced(), forced(elements=40)
    assert rcp.solve(coarse, mesh_tolerance=None).discretisation.is_large
    assert coarse.p.grid.mesh.elements == 4
    assert len(rcp.solve(fine).steps) == 1
    assert fine.p.grid.mesh.elements == 40


@settings(max_examples=3, deadline=None)
@given(distance=st.floats(5.0, 40.0), limit=st.floats(0.8, 2.0), elements=st.integers(5, 20))
@example(distance=19.0, limit=2.0, elements=5)  # the errors of one mesh on the way are larger than those before
def test_limited_speed(distance: float, limit: float, elements: int) -> None:
    duration = rcp.Duration(bounds=(0.1, 100), initial_guess=5)
    result = rcp.solve(rest_to_rest(distance, v={"bounds": (None, limit)}, duration=duration, elements=elements))
    assert result.objective == pytest.approx(distance / limit + limit, rel=1e-3)


@settings(max_examples=4, deadline=None)
@given(limit=st.floats(0.03, 1 / 6), elements=st.integers(4, 20))
def test_a_limit_of_second_order(limit: float, elements: int) -> None:
    assert rcp.solve(bryson_denham(limit, elements=elements)).objective == pytest.approx(4 / (9 * limit), rel=1e-3)


def test_all_phases_are_refined(exact: float) -> None:
    m = pyo.ConcreteModel(name="in two parts")
    m.first, m.second = rcp.PhaseBlock(duration=2.0, elements=2), rcp.PhaseBlock(duration=2.0, elements=2)
    costs = []
    for b, begin in ((m.first, 0.0), (m.second, 2.0)):
        initial = {"initial": 0} if begin == 0.0 else {}
        b.x, b.v, b.u = rcp.State(**initial), rcp.State(**initial), rcp.Control(bounds=(-5, 5))
        b.ode(lambda b, t, begin=begin: {b.x: b.v[t], b.v: b.u[t] + pyo.sin(6 * (t + begin))})
        costs.append(b.integral(lambda b, t: (b.x[t] - 1) ** 2 + 0.1 * b.u[t] ** 2))
    m.joined = rcp.Link(m.first, m.second)
    m.cost = pyo.Objective(expr=sum(costs))
    assert rcp.solve(m).objective == pytest.approx(exact, rel=1e-3)
    assert min(m.first.grid.mesh.elements, m.second.grid.mesh.elements) > 2


def test_pairs_keep_the_mesh() -> None:
    m = forced(scheme="implicit_euler")
    m.p.force = rcp.Algebraic(bounds=(0, None))
    m.p.complementarity(lambda b, t: rcp.complements(b.x[t] + 1 >= 0, b.force[t] >= 0))
    rcp.solve(m)
    assert m.p.grid.mesh.elements == 4


def test_what_cannot_be_solved_on_a_finer_mesh_leaves_the_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    m = bryson_denham(elements=5)
    m.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    alone = rcp.solve(bryson_denham(elements=5), mesh_tolerance=None).objective

    def fails(*_: Any) -> Any:
        raise EvaluationError("no value there")

    solves = iter([mesh_loop.solve_model, fails])
    monkeypatch.setattr(mesh_loop, "solve_model", lambda *given: next(solves)(*given))
    solution(m)
    assert m.p.grid.mesh.elements == 5
    assert pyo.value(m.effort) == pytest.approx(alone, rel=1e-8)
    assert all(row.model() is m for row in m.dual)
    assert len(m.dual) >= len(list(m.p.x_collocation))


@pytest.mark.parametrize("wrong", [0.0, -1.0, "small", float("nan")])
def test_a_wrong_tolerance_is_refused(wrong: Any) -> None:
    with pytest.raises(ValueError, match="mesh_tolerance"):
        rcp.solve(forced(), mesh_tolerance=wrong)


def test_a_boundary_moves_to_where_a_control_switches() -> None:
    """Faster up than down: the switch is after a third of the square root of three."""
    m = rest_to_rest(force=(-1, 2), elements=4)
    assert rcp.solve(m, mesh_tolerance=1e-9).objective == pytest.approx(3**0.5, rel=1e-6)
    assert abs(np.array(m.p.trajectory().grid.mesh.boundaries) - 3**0.5 / 3).min() < 1e-5


def test_a_better_objective_of_a_motion_that_is_none_is_not_kept() -> None:
    """Nishida's problem: the smallest distance from the origin at the end, by one control that switches."""
    m, b = one_phase(duration=4.2, x=rcp.State(index=4, initial=10), u=rcp.Control(bounds=(-1, 1)))

    @b.ode
    def oscillators(b: Any, t: float) -> Any:
        x, u = b.x[t], b.u[t]
        slow = [-0.5 * x[0] + 5 * x[1], -5 * x[0] - 0.5 * x[1] + u]
        return {b.x: [*slow, -0.6 * x[2] + 10 * x[3], -10 * x[2] - 0.6 * x[3] + u]}

    m.cost = pyo.Objective(expr=sum(b.x[i, b.final_time] ** 2 for i in range(4)))
    result = rcp.solve(m, mesh_tolerance=1e-4)
    assert "the first answer, 0." in str(result.remarks)  # ten elements, whose motion is wrong by a quarter
    assert result.objective == pytest.approx(1.003475, rel=2e-3)


@pytest.mark.usefixtures("same_errors_on_any_mesh")
def test_controls_that_do_not_move_the_states_as_planned_start_from_the_guess(monkeypatch: pytest.MonkeyPatch) -> None:
    m, solve = forced(elements=40), mesh_loop.solve_model
    m.p.initialize(u=0.125)
    starts, answers = [], []

    def seen(model: Any, settings: Any) -> rcp.SolveResult:
        starts.append([*m.p.u.get_values().values(), m.p.x[m.p.final_time].value])
        result = solve(model, settings)
        answers.append(m.p.x[m.p.final_time].value)
        return result

    monkeypatch.setattr(mesh_loop, "solve_model", seen)
    rcp.solve(m)
    assert starts[1] == pytest.approx([*[0.125] * (len(starts[1]) - 1), answers[0]])


def test_the_first_lines_say_what_keeps_a_coarse_mesh() -> None:
    m = forced()
    inside = [t for t in m.p.points if t not in m.p.grid.mesh.boundaries][2]
    m.culprit = pyo.Constraint(expr=m.p.x[inside] <= 10.0)
    held = forced()
    held.p.f = rcp.Control(bounds=(-1, 1), parametrization="piecewise_constant")
    held.effort = pyo.Constraint(expr=held.p.integral(lambda b, t: b.f[t] ** 2) <= 1.0)
    for model, name in ((m, "culprit"), (held, "'f'")):
        result = rcp.solve(model)
        assert model.p.grid.mesh.elements == 4
        assert any("The mesh stays as it is" in line and name in line for line in str(result).splitlines()[:4])
