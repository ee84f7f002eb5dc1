"""`homotopy`: the wanted data in the end, halved steps on the way, and a named error where the path ends."""

from __future__ import annotations

import importlib
import io
import itertools
import math

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import EvaluationError, ModelError, SolveFailed
from pyrobocop_pyomo.solving.progress import Progress

# The function of the same name hides its module from an import statement.
module = importlib.import_module("pyrobocop_pyomo.studies.homotopy")
solving_module = importlib.import_module("pyrobocop_pyomo.studies.outcomes")


def corner() -> pyo.ConcreteModel:
    """min (x - p)^2 + (y - q1)^2 + (y - q2)^2 over 0 <= x ⟂ y >= 0."""
    m = pyo.ConcreteModel(name="corner")
    m.p = pyo.Param(initialize=1.0, mutable=True)
    m.q = pyo.Param([1, 2], initialize={1: 0.5, 2: 0.5}, mutable=True)
    m.x = pyo.Var(bounds=(0, None), initialize=1)
    m.y = pyo.Var(bounds=(0, None), initialize=1)
    m.pair = rcp.Complementarity(expr=rcp.complements(m.x >= 0, m.y >= 0))
    m.cost = pyo.Objective(expr=(m.x - m.p) ** 2 + (m.y - m.q[1]) ** 2 + (m.y - m.q[2]) ** 2)
    return m


QUICK = {"strategies": "tight"}


@pytest.mark.casadi
@pytest.mark.parametrize("how", ["name", "pairs", "function"])
def test_the_data_end_where_they_are_wanted(how):
    m = corner()
    path = {
        "name": {"p": (1.5, 3.0), "q": 0.25},
        "pairs": [(m.p, (1.5, 3.0)), (m.q, 0.25)],
        "function": lambda s: (m.p.set_value(1.5 + 1.5 * s), m.q[1].set_value(0.25), m.q[2].set_value(0.25)),
    }[how]
    found = rcp.studies.homotopy(m, path, steps=3, **QUICK)
    assert (m.p.value, m.q[1].value, m.q[2].value) == (3.0, 0.25, 0.25)
    assert m.x.value == pytest.approx(3.0, abs=1e-5)
    assert found.position == 1.0
    assert found.result is not None
    assert found.result.objective == pytest.approx(pyo.value(m.cost))
    assert [step.position for step in found.outcomes] == pytest.approx([0, 1 / 3, 2 / 3, 1])
    assert all(step.accepted for step in found.outcomes)
    assert found.iterations == sum(step.result.iterations for step in found.outcomes)


@pytest.mark.casadi
def test_members_can_have_their_own_ends():
    m = corner()
    rcp.studies.homotopy(m, [(m.q, (0.5, {1: 0.75}))], steps=2, **QUICK)
    assert (m.q[1].value, m.q[2].value) == (0.75, 0.5)


@pytest.mark.casadi
def test_a_fixed_variable_moves_as_well():
    m = corner()
    m.goal = pyo.Var(initialize=1.0)
    m.goal.fix()
    m.row = pyo.Constraint(expr=m.x >= m.goal)
    rcp.studies.homotopy(m, [(m.goal, 2.0)], steps=2, **QUICK)
    assert m.goal.value == 2.0
    assert m.x.value == pytest.approx(2.0, abs=1e-5)


@pytest.mark.casadi
def test_failed_steps_are_halved_and_lengthen_again(monkeypatch):
    solved = solving_module.solve
    m = corner()
    last = [1.0]

    def short_of_breath(model, **options):
        """Follows steps of at most 0.15 in p, up to a quarter of the path, and any from there on."""
        reached = model.p.value
        if last[0] < 1.5 and reached - last[0] > 0.15:
            model.x.set_value(99.0)
            raise EvaluationError("too far")
        last[0] = reached
        return solved(model, **options)

    monkeypatch.setattr(solving_module, "solve", short_of_breath)
    found = rcp.studies.homotopy(m, {"p": (1.0, 3.0)}, steps=4, **QUICK)
    assert found.position == 1.0
    assert m.p.value == 3.0
    assert m.x.value == pytest.approx(3.0, abs=1e-5)
    accepted = [step for step in found.outcomes if step.accepted]
    lengths = [after.position - before.position for before, after in itertools.pairwise(accepted)]
    assert max(lengths[:3]) <= 0.15 / 2 + 1e-12
    assert max(lengths) == 0.25
    assert any(not step.accepted for step in found.outcomes)
    assert "EvaluationError" in str(found)


@pytest.mark.casadi
def test_where_the_path_ends_the_last_solved_data_and_point_are_kept():
    m = corner()
    m.limit = pyo.Constraint(expr=m.x**2 + m.p**2 <= 8.0)
    m.least = pyo.Constraint(expr=m.x >= m.p)  # together p <= 2, which is a third of the path
    with pytest.raises(SolveFailed, match=r"followed to 0\.3\d* of 1") as caught:
        rcp.studies.homotopy(m, {"p": (1.0, 4.0)}, steps=4, smallest_step=1e-2, **QUICK)
    error = caught.value
    assert error.result.position == pytest.approx(1 / 3, abs=1.1e-2)
    assert error.result.position <= 1 / 3 + 1e-5
    assert m.p.value == pytest.approx(1.0 + 3.0 * error.result.position)
    assert m.x.value == pytest.approx(m.p.value, abs=1e-3)


@pytest.mark.casadi
def test_where_the_first_problem_fails_all_is_as_before():
    m = corner()
    m.least = pyo.Constraint(expr=m.x >= m.p)
    m.most = pyo.Constraint(expr=m.x <= 0.5)
    before = (m.p.value, m.x.value, m.y.value)
    with pytest.raises(SolveFailed, match=r"the first problem of the path was not solved") as caught:
        rcp.studies.homotopy(m, {"p": (2.0, 0.1)}, **QUICK)
    assert (m.p.value, m.x.value, m.y.value) == before
    assert caught.value.result.position == -1.0


@pytest.mark.casadi
def test_a_time_limit_ends_the_path():
    m = corner()
    with pytest.raises(SolveFailed, match="time limit"):
        rcp.studies.homotopy(m, {"p": (0.0, 1.0)}, steps=10**6, time_limit=0.3, **QUICK)
    assert math.isfinite(m.x.value)


@pytest.mark.casadi
def test_progress_and_tables(monkeypatch):
    pytest.importorskip("pandas")
    stream = io.StringIO()
    monkeypatch.setattr(module, "Progress", lambda show: Progress(show, stream))
    found = rcp.studies.homotopy(corner(), {"p": (0.0, 1.0)}, steps=2, progress=True, **QUICK)
    lines = [line.rpartition("\r")[2] for line in stream.getvalue().split("\n")]
    assert sum(line.startswith("corner:") for line in lines) == 3
    assert "\rat 0.5" in stream.getvalue()
    assert list(found.to_pandas()["position"]) == [0.0, 0.5, 1.0]
    assert str(found).startswith("corner: followed to 1\n")


@pytest.mark.parametrize(
    ("path", "options", "message"),
    [
        ({"p": (0, 1)}, {"steps": 0}, r"steps = 0; expected"),
        ({"p": (0, 1)}, {"smallest_step": 0}, r"smallest_step = 0; expected"),
        ({}, {}, r"no parameters were given"),
        ({"p": "high"}, {}, r"'p': an end of its path is 'high'"),
        ({"p": (0, math.inf)}, {}, r"'p': an end of its path is inf"),
        ({"x": (0, 1)}, {}, r"'x': is free"),
        ({"nothing": (0, 1)}, {}, r"has no component 'nothing'"),
        (["p"], {}, r"expected a mapping such as"),
        (3, {}, r"expected a mapping such as"),
    ],
)
def test_arguments_that_make_no_sense(path, options, message):
    m = corner()
    with pytest.raises(ModelError, match=message):
        rcp.studies.homotopy(m, path, **options)
    assert m.p.value == 1.0
