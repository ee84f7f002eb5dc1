"""Sequences of modes: all that are allowed, solved in any number of processes, in one order."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import textwrap
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.safety_reports import report_of_a_collision

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError, SolverNotFoundError
from pyrobocop_pyomo.motion import SafetyReport
from pyrobocop_pyomo.studies import sequences

GAINS = {"slow": 1.0, "fast": 2.0, "back": -1.0}


def build(sequence: tuple[str, ...], goal: float = 1.0, sense: Any = pyo.minimize) -> pyo.ConcreteModel:
    """Reach a goal by pushing only, each mode with its gain: the least effort is goal^2 / (sum of gain^2)."""
    if "broken" in sequence:
        raise ArithmeticError("this mode is broken")
    m = pyo.ConcreteModel(name=" - ".join(sequence))
    m.legs = rcp.PhaseBlock(list(enumerate(sequence)), elements=1, rule=state_leg)
    if len(sequence) > 1:
        m.joints = rcp.Link(m.legs)
    first, *_, last = [*m.legs.values()] * 2
    first.x[first.initial_time].fix(0)
    last.x[last.final_time].fix(goal)
    total = sum(leg.integral(lambda b, t: b.u[t] ** 2) for leg in m.legs.values())
    m.effort = pyo.Objective(expr=total if sense == pyo.minimize else -total, sense=sense)
    return m


def state_leg(b: Any, k: int, mode: str) -> None:
    b.x = rcp.State()
    b.u = rcp.Control(bounds=(0, 10))
    b.ode(lambda b, t: {b.x: GAINS[mode] * b.u[t]})


def least_effort(sequence: tuple[str, ...]) -> float:
    return 1 / sum(max(GAINS[mode], 0.0) ** 2 for mode in sequence)


# ---------------------------------------------------------------- which sequences there are


def test_all_sequences_come_in_the_order_of_the_modes() -> None:
    assert rcp.studies.mode_sequences("ab", 2) == [("a", "a"), ("a", "b"), ("b", "a"), ("b", "b")]
    assert rcp.studies.mode_sequences(GAINS, [2, 1])[:3] == [("slow",), ("fast",), ("back",)]
    assert len(rcp.studies.mode_sequences(GAINS, range(1, 5))) == 3 + 9 + 27 + 81


@pytest.mark.parametrize("length", [1, 2, 3, 4])
def test_successions_are_those_of_the_filtered_product(length: int) -> None:
    follow = {"a": "bc", "b": ["a"], "c": ("c", "a")}
    expected = [
        sequence
        for sequence in itertools.product("abc", repeat=length)
        if all(after in follow[before] for before, after in itertools.pairwise(sequence))
    ]
    assert rcp.studies.mode_sequences("abc", length, allowed=follow) == expected
    assert rcp.studies.mode_sequences("abc", length, allowed=lambda before, after: after in follow[before]) == expected


def test_rare_successions_do_not_cost_the_whole_product() -> None:
    modes = [str(i) for i in range(40)]
    found = rcp.studies.mode_sequences(modes, 30, allowed={"0": ["1"], "1": ["0"]})
    assert found == [("0", "1") * 15, ("1", "0") * 15]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((["a", "a"], 1), "mode 'a' is named twice"),
        ((["a"], 0), "length = 0; a sequence has at least one mode"),
        ((["a"], [1, 2.5]), "length = 2.5"),
        (([], 1), "no sequence of no modes has the length 1"),
        ((["a"], []), r"no sequence of 'a' has the length \[\]"),
        ((["a", "b"], 2, {"a": []}), "no sequence of 'a', 'b' has the length 2"),
        ((["a", "b"], 2, {"a": ["c"]}), "allowed= names the mode 'c'; the modes are 'a', 'b'"),
        ((["a", "b"], 2, {"d": ["a"]}), "allowed= names the mode 'd'"),
    ],
)
def test_what_makes_no_sequence_is_refused(arguments: Any, message: str) -> None:
    modes, length, *allowed = arguments
    with pytest.raises(ModelError, match=message):
        rcp.studies.mode_sequences(modes, length, allowed=allowed[0] if allowed else None)


# ---------------------------------------------------------------- their ranking


@pytest.fixture(scope="module")
def serial() -> rcp.studies.SequenceRanking:
    return rcp.studies.solve_sequences(build, rcp.studies.mode_sequences(GAINS, range(1, 3)))


@pytest.mark.casadi
def test_the_ranking_is_that_of_brute_force(serial: rcp.studies.SequenceRanking) -> None:
    sequences = rcp.studies.mode_sequences(GAINS, range(1, 3))
    able = sorted(
        (s for s in sequences if set(s) != {"back"}), key=lambda s: (round(least_effort(s), 9), sequences.index(s))
    )
    assert [outcome.sequence for outcome in serial if outcome.feasible] == able
    assert [outcome.objective for outcome in serial if outcome.feasible] == pytest.approx(
        [least_effort(s) for s in able], rel=1e-6
    )
    assert {outcome.sequence for outcome in serial if not outcome.feasible} == {("back",), ("back", "back")}
    violations = [outcome.result.standing.excess for outcome in serial if not outcome.feasible]
    assert violations == sorted(violations)
    assert serial[0].sequence == ("fast", "fast")
    assert serial.remaining == ()
    alone = build(("fast", "fast"))
    assert rcp.solve(alone).objective == pytest.approx(serial[0].objective, rel=1e-9)


@pytest.mark.casadi
def test_the_best_model_holds_its_solution(serial: rcp.studies.SequenceRanking) -> None:
    best = serial.best_model
    assert best is serial.best_model
    assert pyo.value(best.effort) == pytest.approx(0.125, rel=1e-6)
    joined = rcp.join_trajectories(best.legs.values())
    assert joined(1.0)["x"] == pytest.approx(0.5, abs=1e-6)
    assert all(part.verify().largest_violation < 1e-7 for part in joined.parts)
    assert pyo.value(serial.model(("slow",)).effort) == pytest.approx(1.0, rel=1e-6)
    assert serial.model(("back",)).name == "back"
    with pytest.raises(KeyError):
        serial.model(("up",))


@pytest.mark.casadi
def test_the_table_tells_everything(serial: rcp.studies.SequenceRanking) -> None:
    lines = str(serial).splitlines()
    assert len(lines) == 13
    assert lines[1].split()[:6] == ["1", "fast", "-", "fast", "0.125", "optimal"]
    assert "local infeasibility" in lines[-1]
    pytest.importorskip("pandas")
    frame = serial.to_pandas()
    assert frame.index.tolist() == list(range(1, 13))
    assert frame["sequence"].iloc[0] == "fast - fast"
    assert frame["objective"].isna().sum() == 2
    assert (frame["reason"] != "").sum() == 2
    assert (frame["iterations"] > 0).all()


@pytest.mark.casadi
@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_is_kept_as_the_reason_and_ranks_last(workers: int) -> None:
    ranking = rcp.studies.solve_sequences(
        partial(build, goal=2.0), [("broken",), ("back",), ("slow",)], workers=workers
    )
    assert [outcome.sequence for outcome in ranking] == [("slow",), ("back",), ("broken",)]
    assert ranking[2].verdict == "error"
    assert ranking[2].reason == "ArithmeticError: this mode is broken"
    assert ranking[0].objective == pytest.approx(4.0, rel=1e-6)
    with pytest.raises(
        rcp.errors.SolveFailed, match="broken: there is no solution. ArithmeticError: this mode is broken"
    ):
        ranking.model(("broken",))


@pytest.mark.casadi
def test_a_maximum_ranks_from_the_top() -> None:
    ranking = rcp.studies.solve_sequences(partial(build, sense=pyo.maximize), [("slow",), ("fast",)])
    assert [outcome.sequence for outcome in ranking] == [("fast",), ("slow",)]


@pytest.mark.casadi
def test_without_a_feasible_sequence_there_is_no_best() -> None:
    ranking = rcp.studies.solve_sequences(build, [("back",), "broken"])
    with pytest.raises(rcp.errors.SolveFailed, match="no sequence has a feasible point") as caught:
        _ = ranking.best_model
    assert caught.value.result is ranking
    assert "this mode is broken" in str(caught.value)


@pytest.mark.casadi
def test_options_reach_solve_and_progress_is_a_line_per_sequence(capsys: Any) -> None:
    ranking = rcp.studies.solve_sequences(build, [("slow",), ("fast",)], progress=True, options={"max_iter": 1})
    shown = capsys.readouterr().err
    assert "1/2 slow: feasible" in shown
    assert "2/2 fast" in shown
    assert all(outcome.result.stop_reason is rcp.StopReason.ITERATION_LIMIT for outcome in ranking)


@pytest.mark.casadi
def test_a_builder_that_changes_its_mind_is_found_out() -> None:
    calls = itertools.count()

    def longer(sequence: tuple[str, ...]) -> pyo.ConcreteModel:
        return build(sequence * (1 + next(calls)))

    def dearer(sequence: tuple[str, ...]) -> pyo.ConcreteModel:
        m = build(sequence)
        m.effort.expr *= 1 + next(calls)
        return m

    for fickle, message in (
        (longer, "the model built again has 14 variables where 7 were found"),
        (dearer, "the model built again has the objective .* was found"),
    ):
        ranking = rcp.studies.solve_sequences(fickle, [("slow",)])
        with pytest.raises(ModelError, match=message):
            ranking.model(("slow",))


def test_arguments_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ModelError, match="no sequences to solve"):
        rcp.studies.solve_sequences(build, [])
    for workers in (0, True, 1.5):
        with pytest.raises(ModelError, match="workers = .*; expected a number of processes"):
            rcp.studies.solve_sequences(build, [("slow",)], workers=workers)


@pytest.mark.casadi
def test_a_local_function_cannot_go_to_another_process() -> None:
    with pytest.raises(ModelError, match="build cannot be sent to another process .* or use workers=1"):
        rcp.studies.solve_sequences(lambda sequence: build(sequence), [("slow",)], workers=2)
    with pytest.raises(ModelError, match="the options cannot be sent"):
        rcp.studies.solve_sequences(build, [("slow",)], workers=2, options={"tol": lambda: 1})


def test_without_ipopt_nothing_is_tried(monkeypatch: Any) -> None:
    def none() -> Any:
        raise SolverNotFoundError("no Ipopt here")

    monkeypatch.setattr(sequences, "best_backend", none)
    with pytest.raises(SolverNotFoundError, match="no Ipopt here"):
        rcp.studies.solve_sequences(build, [("slow",)])


# ---------------------------------------------------------------- stopping early


@pytest.mark.casadi
def test_ctrl_c_between_solves_keeps_what_is_done() -> None:
    def pressed(sequence: tuple[str, ...]) -> pyo.ConcreteModel:
        if sequence == ("back",):
            raise KeyboardInterrupt
        return build(sequence)

    ranking = rcp.studies.solve_sequences(pressed, [("slow",), ("fast",), ("back",), ("slow", "slow")])
    assert [outcome.sequence for outcome in ranking] == [("fast",), ("slow",)]
    assert ranking.remaining == (("back",), ("slow", "slow"))
    assert "interrupted; not solved: back; slow - slow" in str(ranking)


LONG = """
    import pyomo.environ as pyo
    import pyrobocop_pyomo as rcp

    def build(sequence):
        m = pyo.ConcreteModel()
        size = 1 if sequence == ("short",) else 20000
        m.x = pyo.Var(range(size), initialize=0)
        m.cost = pyo.Objective(expr=sum(pyo.exp(-m.x[i]) for i in m.x) if size > 1 else m.x[0] ** 2)
        return m

    if __name__ == "__main__":
        print("started", flush=True)
        tight = {"tol": 1e-300, "dual_inf_tol": 1e-300, "acceptable_iter": 0}
        ranking = rcp.studies.solve_sequences(build, [("short",), ("endless",), ("late",), ("later",)], workers=WORKERS,
                                      options=tight, progress=True)
        print([outcome.sequence for outcome in ranking], ranking.remaining, flush=True)
"""


@pytest.mark.casadi
@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.ctrl_c
def test_ctrl_c_during_a_solve_stops_every_process_soon(workers: int, tmp_path: Path) -> None:
    script = tmp_path / "long.py"
    script.write_text(textwrap.dedent(LONG).replace("WORKERS", str(workers)))
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    running = subprocess.Popen(
        [sys.executable, script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )
    try:
        while "1/4" not in (line := running.stderr.readline()):  # the line of the first sequence, which is short
            assert line, "ended without a line of progress"
        time.sleep(1.0)
        pressed = time.perf_counter()
        running.send_signal(signal.SIGINT)
        out, errors = running.communicate(timeout=900)
    finally:
        running.kill()
    assert running.returncode == 0, errors
    assert "[('short',)] (('endless',), ('late',), ('later',))" in out
    assert "Traceback" not in errors
    assert time.perf_counter() - pressed < 15


@pytest.mark.casadi
def test_a_script_without_a_main_guard_is_told_so(tmp_path: Path) -> None:
    script = tmp_path / "unguarded.py"
    body = textwrap.dedent(LONG).replace("WORKERS", "2").replace('if __name__ == "__main__":', "if True:")
    script.write_text(body)
    ended = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=900)
    assert ended.returncode != 0
    assert "put the call under 'if __name__" in ended.stderr


@pytest.mark.casadi
def test_a_safe_plan_comes_before_a_cheaper_one_that_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    solved = sequences.solve_as_given

    def judged(model: Any, **options: Any) -> Any:
        result = solved(model, **options)
        if model.name != "fast":
            return replace(result, safety=SafetyReport(()))
        return replace(result, safety=report_of_a_collision(), standing=replace(result.standing, shortfall=1.0))

    monkeypatch.setattr(sequences, "solve_as_given", judged)
    ranking = rcp.studies.solve_sequences(build, [("fast",), ("slow",)], workers=1)
    assert [outcome.sequence for outcome in ranking] == [("slow",), ("fast",)]
    assert ranking[1].objective < ranking[0].objective
    assert "not proven" in ranking[1].reason
