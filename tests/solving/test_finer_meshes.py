"""`solve` refines a mesh that makes too large an error, and keeps what the model states."""

from __future__ import annotations

from typing import Any

import pyomo.environ as pyo
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.planning.finer_meshes import FinerMeshes

pytestmark = pytest.mark.ipopt


def forced(elements: int = 4, **phase: Any) -> Any:
    """A forcing of four periods, of which so few elements see little."""
    m = pyo.ConcreteModel(name="forced")
    m.p = b = rcp.PhaseBlock(duration=4.0, elements=elements, **phase)
    b.x, b.v, b.u = rcp.State(initial=0), rcp.State(initial=0), rcp.Control(bounds=(-5, 5))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] + pyo.sin(6 * t)})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.x[t] - 1) ** 2 + 0.1 * b.u[t] ** 2))
    return m


def speed_limit(distance: float, limit: float, elements: int) -> Any:
    m = pyo.ConcreteModel(name="speed limit")
    duration = rcp.Duration(bounds=(0.1, 100), initial_guess=5)
    m.p = b = rcp.PhaseBlock(duration=duration, elements=elements)
    b.x, b.v = rcp.State(initial=0, final=distance), rcp.State(initial=0, final=0, bounds=(None, limit))
    b.u = rcp.Control(bounds=(-1, 1))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
    m.time = pyo.Objective(expr=b.duration)
    return m


def bryson_denham(limit: float, elements: int) -> Any:
    m = pyo.ConcreteModel(name="Bryson and Denham")
    m.p = b = rcp.PhaseBlock(duration=1.0, elements=elements)
    b.x, b.v = rcp.State(initial=0, final=0, bounds=(None, limit)), rcp.State(initial=1, final=-1)
    b.u = rcp.Control()
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 / 2))
    return m


@pytest.fixture(scope="module")
def exact() -> float:
    found: float = rcp.solve(forced(elements=100), mesh_tolerance=None).objective
    return found


def test_three_digits_are_right_and_the_result_says_on_which_mesh(exact: float) -> None:
    m = forced()
    result = rcp.solve(m)
    assert result.solved
    assert result.objective == pytest.approx(exact, rel=1e-3)
    assert not result.discretisation.is_large
    assert any(f"from 4 to {m.p.grid.mesh.elements} elements" in remark for remark in result.remarks)
    assert result.best_step == len(result.steps) - 1
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


def test_the_mesh_stays_without_tolerance_and_where_it_is_fine_enough() -> None:
    coarse, fine = forced(), forced(elements=40)
    assert rcp.solve(coarse, mesh_tolerance=None).discretisation.is_large
    assert coarse.p.grid.mesh.elements == 4
    assert len(rcp.solve(fine).steps) == 1
    assert fine.p.grid.mesh.elements == 40


@settings(max_examples=10, deadline=None)
@given(distance=st.floats(5.0, 40.0), limit=st.floats(0.8, 2.0), elements=st.integers(5, 20))
def test_limited_speed(distance: float, limit: float, elements: int) -> None:
    result = rcp.solve(speed_limit(distance, limit, elements))
    assert result.objective == pytest.approx(distance / limit + limit, rel=1e-3)


@settings(max_examples=10, deadline=None)
@given(limit=st.floats(0.03, 1 / 6), elements=st.integers(4, 20))
def test_a_limit_of_second_order(limit: float, elements: int) -> None:
    assert rcp.solve(bryson_denham(limit, elements)).objective == pytest.approx(4 / (9 * limit), rel=1e-3)


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


def test_what_the_user_holds_stays() -> None:
    m = forced()
    end = m.p.x[m.p.final_time]
    m.reached = pyo.Constraint(expr=end >= 0.5)
    m.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    result = rcp.solve(m)
    assert result.solved
    assert end is m.p.x[m.p.final_time]
    assert all(row.model() is m for row in m.dual)
    assert {row.parent_component().local_name for row in m.dual} >= {"reached", "x_collocation"}


def test_a_row_at_a_point_that_would_go_keeps_the_mesh() -> None:
    m = forced()
    inside = [t for t in m.p.points if t not in m.p.grid.mesh.boundaries][2]
    m.there = pyo.Constraint(expr=m.p.x[inside] <= 10.0)
    result = rcp.solve(m)
    assert result.solved
    assert m.p.grid.mesh.elements == 4
    assert any("The mesh stays as it is" in remark and "there" in remark for remark in result.remarks)


def test_pairs_keep_the_mesh() -> None:
    m = forced(scheme="implicit_euler")
    m.p.force = rcp.Algebraic(bounds=(0, None))
    m.p.complementarity(lambda b, t: rcp.complements(b.x[t] + 1 >= 0, b.force[t] >= 0))
    rcp.solve(m)
    assert m.p.grid.mesh.elements == 4


def test_what_cannot_be_solved_on_a_finer_mesh_leaves_the_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    m = forced()
    m.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    alone = rcp.solve(forced(), mesh_tolerance=None).objective

    def fails(*_: Any) -> Any:
        raise EvaluationError("no value there")

    monkeypatch.setattr(FinerMeshes, "_solved", fails)
    result = rcp.solve(m)
    assert result.solved
    assert m.p.grid.mesh.elements == 4
    assert pyo.value(m.cost) == pytest.approx(alone, rel=1e-8)
    assert all(row.model() is m for row in m.dual)
    assert len(m.dual) >= len(list(m.p.x_collocation))


def test_as_a_pyomo_solver(exact: float) -> None:
    refined, kept = forced(), forced()
    pyo.SolverFactory("pyrobocop.mpcc").solve(refined)
    pyo.SolverFactory("pyrobocop.mpcc", mesh_tolerance=None).solve(kept)
    assert pyo.value(refined.cost) == pytest.approx(exact, rel=1e-3)
    assert kept.p.grid.mesh.elements == 4


@pytest.mark.parametrize("wrong", [0.0, -1.0, "small", float("nan")])
def test_a_wrong_tolerance_is_refused(wrong: Any) -> None:
    with pytest.raises(ValueError, match="mesh_tolerance"):
        rcp.solve(forced(), mesh_tolerance=wrong)
