"""Looking beyond the nearest solution: it has a budget, is shown, can be interrupted, and loses nothing."""

import time
from functools import partial
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.observed_runs import (
    LinearProgram,
    before_linear_programs,
    count_linear_programs,
    interrupt_run,
    slow_linear_programs,
    use_processor_time,
)
from harness.timed_models import crossed_pairs
from known_mpccs import mpcc_problem

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.solving.record import EXPLORED_SECONDS

pytestmark = pytest.mark.casadi

solve = partial(rcp.solve, progress=False)
UNLIMITED = float("inf")
# Its linear programs name several branches that are worth a run.
EXPLORED = "crossed qpec 2x4"


def labels(result: Any) -> list[str]:
    return [step.label for step in result.steps]


def explored(result: Any) -> list[Any]:
    return [step for step in result.steps if step.label.startswith("explore")]


def objective(model: pyo.ConcreteModel) -> float:
    (found,) = model.component_data_objects(pyo.Objective, active=True)
    return pyo.value(found)


# ------------------------------------------------------------------------------------------------- budget


def test_without_exploration_nothing_is_explored() -> None:
    assert explored(solve(mpcc_problem(EXPLORED).build(), strategies=rcp.Strategy(exploration=0))) == []
    assert explored(solve(mpcc_problem(EXPLORED).build(), strategies=rcp.Strategy(exploration=UNLIMITED)))


@pytest.mark.parametrize("exploration", [-1.0, float("nan")])
def test_a_budget_that_is_no_factor_is_refused(exploration: Any) -> None:
    with pytest.raises((ValueError, TypeError), match="exploration"):
        solve(mpcc_problem(EXPLORED).build(), strategies=rcp.Strategy(exploration=exploration))


@pytest.mark.parametrize("pairs", [20, 50])
@pytest.mark.parametrize("exploration", [None, 0.5])
def test_exploration_costs_no_more_than_the_solve_so_far_or_a_second(
    pairs: int, exploration: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    use_processor_time(monkeypatch)
    result = solve(crossed_pairs(pairs), strategies=rcp.Strategy(exploration=exploration))
    spent = sum(step.seconds for step in explored(result))
    # The clock is read between two linear programs or two runs; both stop by clocks of their own.
    budget = (exploration or 1.0) * (result.seconds - spent)
    assert spent <= (max(EXPLORED_SECONDS, budget) if exploration is None else budget) + 0.5


def test_slow_linear_programs_do_not_make_the_solve_slow(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = solve(crossed_pairs(30), strategies=rcp.Strategy(exploration=0))
    slow_linear_programs(monkeypatch, longest=5.0)
    started = time.perf_counter()
    result = solve(crossed_pairs(30))
    assert result.objective == pytest.approx(plain.objective, rel=1e-6)
    spent = sum(step.seconds for step in explored(result))
    elsewhere = result.seconds - spent
    assert time.perf_counter() - started <= elsewhere + max(EXPLORED_SECONDS, elsewhere) + 0.5
    assert spent <= max(EXPLORED_SECONDS, result.seconds - spent) + 0.5


# ------------------------------------------------------------------------------------------------- no cliff


def test_as_many_linear_programs_for_eighty_pairs_as_for_a_hundred_and_twenty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Counted where each of them costs nothing, so that no budget decides."""
    slow_linear_programs(monkeypatch, longest=0.0)
    programs = count_linear_programs(monkeypatch)
    counts = {}
    for pairs in (80, 100, 101, 120):
        programs.clear()
        solve(crossed_pairs(pairs), strategies=rcp.Strategy(exploration=UNLIMITED))
        counts[pairs] = len(programs)
    assert max(counts.values()) <= 2 * min(counts.values()), counts


# ------------------------------------------------------------------------------------------------- shown


def test_linear_programs_and_explored_runs_are_steps_with_seconds(capsys: pytest.CaptureFixture[str]) -> None:
    result = rcp.solve(mpcc_problem(EXPLORED).build(), strategies=rcp.Strategy(exploration=UNLIMITED), progress=True)
    shown = capsys.readouterr()
    assert any(label.startswith("explore") for label in labels(result))
    assert all(step.seconds > 0.0 for step in explored(result))
    assert all(step.options for step in explored(result) if step.status is not None)
    assert "explore" in result.report()
    assert "explore" in shown.out + shown.err


# ------------------------------------------------------------------------------------------------- interrupted


def press_in_linear_program(monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    def press(program: LinearProgram) -> None:
        if program.number == number:
            raise KeyboardInterrupt

    before_linear_programs(monkeypatch, press)


@pytest.mark.parametrize(
    ("name", "backend"),
    [(name, "asl") for name in ("ralph1", "bard1", "scholtes4", EXPLORED)]
    + [("ralph1", "vectorised"), (EXPLORED, "vectorised")],
)
@pytest.mark.parametrize("number", [0, 1, 3])
def test_ctrl_c_in_a_linear_program_keeps_the_point(
    name: str, number: int, backend: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = solve(mpcc_problem(name).build(), backend=backend, strategies=rcp.Strategy(exploration=0))
    with monkeypatch.context() as counted:
        programs = count_linear_programs(counted)
        solve(mpcc_problem(name).build(), backend=backend, strategies=rcp.Strategy(exploration=UNLIMITED))
    number = min(number, len(programs) - 1)
    press_in_linear_program(monkeypatch, number)
    model = mpcc_problem(name).build()
    result = solve(model, backend=backend, strategies=rcp.Strategy(exploration=UNLIMITED))
    assert result.stop_reason is rcp.StopReason.INTERRUPTED
    assert result.quality is not rcp.Quality.INFEASIBLE
    assert result.largest_natural_residual <= 1e-6
    assert objective(model) == pytest.approx(result.objective)
    sign = -1.0 if next(model.component_data_objects(pyo.Objective)).sense == pyo.maximize else 1.0
    # Which strategy was interrupted differs; what the first one found is there in any case.
    assert sign * result.objective <= sign * plain.objective + 0.2 * max(1.0, abs(plain.objective))
    assert all(pair.active for pair in model.component_data_objects(rcp.Complementarity))


@pytest.mark.parametrize("backend", ["asl", "vectorised"])
def test_ctrl_c_in_an_explored_run_keeps_the_optimum_and_stops(backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = solve(mpcc_problem(EXPLORED).build(), backend=backend, strategies=rcp.Strategy(exploration=UNLIMITED))
    runs = [step for step in plain.steps if step.status is not None]
    number = next(i for i, step in enumerate(runs) if step.label.startswith("explore"))
    interrupt_run(monkeypatch, number)
    model = mpcc_problem(EXPLORED).build()
    result = solve(model, backend=backend, strategies=rcp.Strategy(exploration=UNLIMITED))
    assert result.stop_reason is rcp.StopReason.INTERRUPTED
    again = [step for step in result.steps if step.status is not None]
    assert len(again) == number + 1
    assert again[-1].status is IpoptStatus.INTERRUPTED
    # The optimum that the first strategy found and proved.
    before = runs[number - 1]
    assert result.objective == pytest.approx(before.objective, rel=1e-6)
    assert objective(model) == pytest.approx(result.objective)
    assert result.quality is rcp.Quality.OPTIMAL
    assert result.largest_natural_residual <= 1e-6


def test_ctrl_c_in_the_exploration_of_an_optimum_leaves_it_certified(monkeypatch: pytest.MonkeyPatch) -> None:
    def press(program: LinearProgram) -> None:
        if program.explores:
            raise KeyboardInterrupt

    before_linear_programs(monkeypatch, press)
    result = solve(mpcc_problem(EXPLORED).build(), strategies=rcp.Strategy(exploration=UNLIMITED))
    assert result.stop_reason is rcp.StopReason.INTERRUPTED
    assert result.certificate is Certificate.PROVEN
    assert result.quality is rcp.Quality.OPTIMAL
