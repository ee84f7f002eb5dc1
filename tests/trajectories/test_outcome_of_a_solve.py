"""A trajectory says how the solve ended that has left its values: a guess and a failure look like no plan."""

from __future__ import annotations

import pickle
from pathlib import Path

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp


def cart(*, limit: float = 10.0) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel(name="cart")
    m.go = b = rcp.PhaseBlock(duration=1.0, elements=4)
    b.x, b.v = rcp.State(initial=0, final=1, initial_guess=0), rcp.State(initial=0, final=0, initial_guess=0)
    b.u = rcp.Control(bounds=(-limit, limit), initial_guess=0)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m


def test_values_that_no_solve_left_say_so(tmp_path: Path) -> None:
    guess = cart().go.trajectory()
    assert "not solved" in repr(guess)
    assert "not solved" in guess._repr_html_()
    assert "not solved" in guess.plot().get_suptitle()
    assert "not solved" in repr(rcp.Trajectory.load(guess.save(tmp_path / "guess")))


@pytest.mark.ipopt
def test_a_solution_says_so_and_keeps_its_title(tmp_path: Path) -> None:
    m = cart()
    rcp.solve(m)
    plan = m.go.trajectory()
    assert "'go', solved," in repr(plan)
    assert plan.plot().get_suptitle() == "go"
    assert rcp.Trajectory.load(plan.save(tmp_path / "plan")).outcome == "solved"


@pytest.mark.ipopt
def test_a_failure_is_told_by_repr_and_titles() -> None:
    m = cart(limit=1.0)
    assert not rcp.solve(m).solved
    plan = m.go.trajectory()
    assert "'go', infeasible," in repr(plan)
    assert plan.plot().get_suptitle() == "go (infeasible)"
    joined = rcp.join_trajectories([plan, m.go])
    assert "infeasible" in repr(joined)
    assert "infeasible" in joined.plot().get_suptitle()


@pytest.mark.ipopt
def test_what_is_changed_after_a_solve_is_no_solution() -> None:
    m = cart()
    rcp.solve(m)
    final = m.go.x[m.go.final_time].value
    m.go.x[0.5].set_value(0.3)
    assert "changed since" in repr(m.go.trajectory())
    m.go.remesh(3)
    assert "changed since" in repr(m.go.trajectory())
    rcp.solve(m)
    assert m.go.trajectory().outcome == "solved"
    assert m.go.x[m.go.final_time].value == pytest.approx(final)


@pytest.mark.ipopt
def test_clones_and_pickles_remember() -> None:
    m = cart()
    rcp.solve(m)
    for other in (m.clone(), pickle.loads(pickle.dumps(m))):
        assert other.go.trajectory().outcome == "solved"


@pytest.mark.ipopt
def test_a_point_that_a_study_loads_is_that_of_its_result() -> None:
    m = cart()
    several = rcp.studies.multistart(m, starts=2)
    assert m.go.trajectory().outcome == "solved"
    m.go.x[0.5].set_value(0.3)
    several.load(1)
    assert m.go.trajectory().outcome == several.outcomes[1].result.outcome == "solved"


@pytest.mark.ipopt
def test_doubts_are_told() -> None:
    m = cart()
    result = rcp.solve(m)
    doubtful = type(result)(**{**vars(result), "doubts": ("something",)})
    assert doubtful.outcome == "DOUBTFUL"
