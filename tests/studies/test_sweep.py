"""`sweep`: cases do not touch each other, go on where they were stopped, and are the same in several processes."""

import importlib
import os
import signal
import subprocess
import sys
import textwrap
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError, SolveFailed, TeamError
from pyrobocop_pyomo.execution import worker_host
from pyrobocop_pyomo.studies.sweep_cases import LONGEST_CHAIN, read_cases, starting_cases

case_solver = importlib.import_module("pyrobocop_pyomo.studies.case_solver")


def spring(pull: float = 1.0) -> pyo.ConcreteModel:
    """A mass that is pulled against a wall at 1: x = min(pull, 1), and the wall pushes with the rest."""
    m = pyo.ConcreteModel(name="spring")
    m.pull = pyo.Param(initialize=pull, mutable=True, within=pyo.Reals)
    m.least = pyo.Param(initialize=-10.0, mutable=True, within=pyo.Reals)
    m.x = pyo.Var(initialize=0.3, bounds=(-10, 10))
    m.wall = pyo.Var(initialize=0.2, bounds=(0, None))
    m.balance = pyo.Constraint(expr=m.x + m.wall == m.pull)
    m.above = pyo.Constraint(expr=m.x >= m.least)
    m.contact = rcp.Complementarity(expr=rcp.complements(m.wall >= 0, 1 - m.x >= 0))
    m.cost = pyo.Objective(expr=(m.x - 0.5) ** 2)
    return m


def expected(pull: float) -> float:
    return (min(pull, 1.0) - 0.5) ** 2


def numbers(m: Any, result: Any) -> dict[str, float]:
    return {"x": m.x.value, "wall": m.wall.value}


def facts(m: Any) -> list[Any]:
    variables = [(v.value, v.fixed, v.lb, v.ub) for v in m.component_data_objects(pyo.Var)]
    return [variables, m.pull.value, m.least.value, [c.name for c in m.component_objects()]]


PULLS = [0.2, 0.7, 1.4, 2.0]


@pytest.mark.casadi
def test_each_case_has_its_own_solution_and_the_model_is_as_it_was() -> None:
    m = spring()
    before = facts(m)
    found = rcp.sweep(m, [{"pull": pull} for pull in PULLS], read=numbers)
    assert [outcome.objective for outcome in found] == pytest.approx([expected(pull) for pull in PULLS], abs=1e-7)
    assert [outcome.numbers["x"] for outcome in found] == pytest.approx([min(p, 1) for p in PULLS], abs=1e-6)
    assert found.reached
    assert found.best.case.number == 1
    assert facts(m) == before
    frame = found.to_pandas()
    assert frame["pull"].tolist() == PULLS
    assert frame["x"].tolist() == pytest.approx([min(p, 1) for p in PULLS], abs=1e-6)
    assert found.load(3) is found[3].result
    assert (m.pull.value, m.x.value) == pytest.approx((2.0, 1.0), abs=1e-6)


@pytest.mark.ipopt
def test_workers_that_are_threads_share_no_model() -> None:
    pulls = np.linspace(-1.0, 2.0, 12).tolist()
    with ThreadPoolExecutor(2) as executor:
        cases = [{"pull": pull} for pull in pulls]
        found = rcp.sweep(spring(), cases, engine=rcp.teams.ExecutorEngine(executor, 2))
    assert [outcome.objective for outcome in found] == pytest.approx([expected(pull) for pull in pulls], abs=1e-7)


@pytest.mark.casadi
def test_a_neighbour_is_gone_on_from_and_gives_what_a_cold_solve_gives() -> None:
    m = spring()
    warm = rcp.sweep(m, [{"pull": pull} for pull in PULLS])
    cold = rcp.sweep(m, [{"pull": pull} for pull in PULLS], start_from=None)
    assert [outcome.started_from for outcome in warm] == [None, 0, 1, 2]
    assert [outcome.started_from for outcome in cold] == [None] * 4
    assert warm.iterations < cold.iterations / 2
    for one, other in zip(warm, cold, strict=True):
        assert one.objective == pytest.approx(other.objective, abs=1e-7)
        assert one.certificate == other.certificate == "proven"


@pytest.mark.casadi
def test_an_infeasible_case_spoils_no_other() -> None:
    m = spring()
    cases = [{"pull": 0.4}, {"pull": 0.5, "least": 3.0}, *({"pull": 0.6 + 0.05 * k} for k in range(5))]
    found = rcp.sweep(m, cases)
    assert [outcome.verdict for outcome in found] == ["optimal", "infeasible", *["optimal"] * 5]
    assert [outcome.case.number for outcome in found.failed] == [1]
    assert 1 not in [outcome.started_from for outcome in found]
    with pytest.raises(SolveFailed, match="1 cases were not solved, 0 not tried. The first is"):
        found.raise_for_status()


@pytest.mark.casadi
def test_a_case_that_raises_is_told_and_the_others_go_on() -> None:
    def put(m: Any, pull: float) -> None:
        if pull < 0:
            raise ArithmeticError("negative pull")
        m.pull = pull

    def read(m: Any, result: Any) -> dict[str, Any]:
        return {"inverse": 1 / (m.pull.value - 0.7)}

    found = rcp.sweep(spring(), {"good": 0.2, "broken": -1.0, "unread": 0.7}, put=put, read=read)
    assert [outcome.name for outcome in found] == ["good", "broken", "unread"]
    assert found[1].reason == "ArithmeticError: negative pull"
    assert found[2].feasible
    assert found[2].error.startswith("read: ZeroDivisionError")
    assert len(found.failed) == 2
    assert "negative pull" in str(found)


@pytest.mark.casadi
@pytest.mark.parametrize(
    ("top", "is_told"),
    [
        (lambda m: pyo.value(m.tilt), True),
        (lambda m: m.tilt, False),
    ],
)
def test_a_sweep_of_what_no_row_reads_says_so_first(top: Any, is_told: bool) -> None:
    m = spring()
    m.tilt = pyo.Param(initialize=1.0, mutable=True)
    m.top = pyo.Expression(expr=top(m))
    m.more = pyo.Constraint(expr=m.x <= 5 * m.top)
    found = rcp.sweep(m, [{"pull": 0.2, "tilt": 1.0}, {"pull": 0.7, "tilt": 2.0}])
    assert str(found).startswith("DOUBTFUL: no row, objective or bound reads 'tilt':") == is_told
    assert ("DOUBTFUL" in repr(found)) == is_told
    m.more.deactivate()
    m.x.setub(3 * m.tilt)
    assert not rcp.sweep(m, [{"tilt": 1.0}, {"tilt": 2.0}]).doubts


@pytest.mark.casadi
def test_a_builder_makes_the_model_of_each_case() -> None:
    found = rcp.sweep(spring, PULLS, read=numbers)
    assert [outcome.numbers["x"] for outcome in found] == pytest.approx([min(p, 1) for p in PULLS], abs=1e-6)
    assert [outcome.started_from for outcome in found] == [None, 0, 1, 2]
    with pytest.raises(SolveFailed, match="a builder makes the model"):
        found.load(1)


@pytest.mark.casadi
def test_a_free_variable_is_fixed_for_its_case_only() -> None:
    m = pyo.ConcreteModel(name="valley")
    m.x, m.y = pyo.Var(initialize=1.0), pyo.Var([1, 2], initialize=1.0)
    m.cost = pyo.Objective(expr=(m.x - 2) ** 2 + sum((m.y[i] - m.x) ** 2 for i in m.y))
    found = rcp.sweep(m, [{"x": 0.0}, {"y": {1: 0.0}}, {"y": [0.0, 3.0]}, [(m.x, 1.0)]])
    assert [outcome.objective for outcome in found] == pytest.approx([4.0, 2.0, 14 / 3, 1.0], abs=1e-7)
    assert not m.x.fixed
    assert not m.y[1].fixed


@pytest.mark.parametrize(
    ("cases", "changes", "message"),
    [
        ([], {}, "no cases to solve"),
        (5, {}, "cases is int"),
        ([{"push": 1.0}], {}, "has no component 'push'"),
        ([{"pull": float("nan")}], {}, "'pull': a case gives it nan; expected a finite number"),
        ([{"balance": 1.0}], {}, "'balance': mutable Params and Vars hold data"),
        ([{"pull": [1.0, 2.0]}], {}, "'pull': a case has 2 values for its 1 members"),
        ([{"pull": {3: 1.0}}], {}, "'pull': has no index 3"),
        ([{"pull": 1.0}], {"workers": 0}, "workers = 0; expected a number of processes"),
        ([{"pull": 1.0}], {"start_from": "best"}, "start_from = 'best'"),
        ([{"pull": 1.0}] * 2, {"start_from": lambda number: 1 - number}, r"start_from\(0\) is 1; .* an earlier case"),
        ([object()], {"file": "x", "put": print}, "a object has no fingerprint"),
    ],
)
def test_what_makes_no_sense_is_refused_before_any_solve(
    cases: Any, changes: Any, message: str, monkeypatch: Any, tmp_path: Path
) -> None:
    def never(*_: Any, **__: Any) -> None:
        raise AssertionError

    monkeypatch.setattr(case_solver, "solve_as_given", never)
    monkeypatch.chdir(tmp_path)
    m = spring()
    before = facts(m)
    with pytest.raises(ModelError, match=message):
        rcp.sweep(m, cases, **changes)
    assert facts(m) == before


def test_a_builder_that_takes_no_data_is_refused_before_it_is_called() -> None:
    def builder() -> None:
        raise AssertionError

    with pytest.raises(ModelError, match=r"builder cannot be called with the data of a case.*put="):
        rcp.sweep(builder, [{"pull": 1.0}])


# ---------------------------------------------------------------- which case starts from which


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=40))
@settings(max_examples=40)
def test_every_chain_of_neighbours_ends_and_is_short(points: list[float]) -> None:
    parents = starting_cases(read_cases([{"p": point} for point in points]), "nearest")
    assert parents[0] is None
    for number in range(len(points)):
        length, here = 0, parents[number]
        while here is not None:
            length, here = length + 1, parents[here]
        assert length < LONGEST_CHAIN


def test_the_neighbour_is_the_nearest_case() -> None:
    order = [0.5, 0.1, 0.9, 0.2, 0.8]
    parents = starting_cases(read_cases([{"p": p, "same": 1.0} for p in order]), "nearest")
    assert parents == [None, 3, 4, 0, 0]


# ---------------------------------------------------------------- a file of outcomes


@pytest.mark.casadi
def test_a_sweep_goes_on_behind_what_is_in_its_file(tmp_path: Path) -> None:
    cases, file = [{"pull": pull} for pull in PULLS], tmp_path / "new" / "outcomes.jsonl"
    whole = rcp.sweep(spring(), cases, read=numbers)
    first = rcp.sweep(spring(), cases[:2], read=numbers, file=file)
    with file.open("ab") as broken:
        broken.write(b'{"key": "half a li')
    solved: list[Any] = []
    second = rcp.sweep(spring(), cases, read=lambda m, r: solved.append(1) or numbers(m, r), file=file)
    assert len(solved) == 2
    assert [outcome.seconds for outcome in second][:2] == [outcome.seconds for outcome in first]
    for one, other in zip(second, whole, strict=True):
        assert (one.objective, one.numbers, one.values) == (other.objective, other.numbers, other.values)
        assert (one.iterations, one.verdict, one.certificate) == (other.iterations, other.verdict, other.certificate)
        assert one.standing == other.standing
    assert second.reached
    third = rcp.sweep(spring(), cases, read=numbers, file=file)
    assert str(third) == str(second)


@pytest.mark.casadi
def test_a_file_of_something_else_is_refused(tmp_path: Path) -> None:
    cases, file = [{"pull": 0.5}], tmp_path / "outcomes.jsonl"
    rcp.sweep(spring(), cases, file=file)
    with pytest.raises(TeamError, match="is of another sweep: 'options'"):
        rcp.sweep(spring(), cases, file=file, options={"tol": 1e-9})
    for content in ("a table\n", '{"kind": "something"}\n', "no line at all"):
        file.write_text(content)
        with pytest.raises(TeamError, match=r"outcomes\.jsonl"):
            rcp.sweep(spring(), cases, file=file)
        assert file.read_text() == content


# ---------------------------------------------------------------- several processes


def test_what_cannot_be_sent_to_a_process_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker_host, "cloudpickle_available", False)
    with pytest.raises(ModelError, match="put cannot be sent to another process"):
        rcp.sweep(spring, PULLS, put=lambda m, pull: None, workers=2)
    model = spring()
    model.note = lambda: None
    with pytest.raises(ModelError, match="the model cannot be sent to another process.*cloudpickle"):
        rcp.studies.multistart(model, starts=2, workers=2)


# ---------------------------------------------------------------- stopping early


@pytest.mark.casadi
def test_ctrl_c_between_cases_keeps_what_is_done() -> None:
    def pressed(pull: float) -> pyo.ConcreteModel:
        if pull == 1.4:
            raise KeyboardInterrupt
        return spring(pull)

    found = rcp.sweep(pressed, PULLS, start_from=None)
    assert [outcome.name for outcome in found] == ["0.2", "0.7"]
    assert found.remaining == ("1.4", "2")
    assert "2 cases were left undone" in str(found)


LONG = """
    import pyomo.environ as pyo
    import pyrobocop_pyomo as rcp
    from concurrent.futures import ThreadPoolExecutor

    def build(name):
        m = pyo.ConcreteModel()
        size = 1 if name == "short" else 20000
        m.x = pyo.Var(range(size), initialize=0)
        m.cost = pyo.Objective(expr=sum(pyo.exp(-m.x[i]) for i in m.x) if size > 1 else m.x[0] ** 2)
        return m

    if __name__ == "__main__":
        print("started", flush=True)
        tight = {"tol": 1e-300, "dual_inf_tol": 1e-300, "acceptable_iter": 0, "max_iter": 1000000}
        found = rcp.sweep(build, ["short", "endless", "late", "later"], start_from=None, **WHERE,
                          options=tight, progress=True)
        print([outcome.name for outcome in found], found.remaining, flush=True)
"""


@pytest.mark.casadi
@pytest.mark.slow
@pytest.mark.parametrize(
    "where", ["dict(workers=1)", "dict(workers=2)", "dict(engine=rcp.teams.ExecutorEngine(ThreadPoolExecutor(2), 2))"]
)
@pytest.mark.ctrl_c
def test_ctrl_c_during_a_solve_stops_every_process_and_thread_soon(where: str, tmp_path: Path) -> None:
    script = tmp_path / "long.py"
    script.write_text(textwrap.dedent(LONG).replace("WHERE", where))
    path = str(Path(__file__).parents[2])
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": path}
    running = subprocess.Popen(
        [sys.executable, script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )
    try:
        shown = ""
        while "1/4" not in shown:  # how far it is after the first case, which is short
            character = running.stderr.read(1)
            assert character, "ended without showing progress"
            shown += character
        time.sleep(1.0)
        pressed = time.perf_counter()
        running.send_signal(signal.SIGINT)
        out, errors = running.communicate(timeout=900)
    finally:
        running.kill()
    assert running.returncode == 0, errors
    assert "['short'" in out  # and what the interrupted solves have found
    assert "'later'" in out.rpartition("]")[2]
    assert "Traceback" not in errors
    assert time.perf_counter() - pressed < 15
