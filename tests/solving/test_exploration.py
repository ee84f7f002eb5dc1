"""Looking beyond the nearest solution: it has a budget, is shown, can be interrupted, and loses nothing."""

import time
from functools import partial
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.observed_runs import (
    before_linear_programs,
    count_linear_programs,
    interrupt_run,
    observe_options,
    slow_linear_programs,
    use_processor_time,
)
from harness.timed_models import TIMED_MODELS, crossed_pairs
from known_mpccs import mpcc_problem
from pyomo.contrib.solver.common.factory import SolverFactory
from pyomo.contrib.solver.common.results import TerminationCondition

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.solving.record import EXPLORED_SECONDS
from pyrobocop_pyomo.studies import PersistentNLP

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


@pytest.mark.parametrize(("pairs", "exploration"), [(20, 0.5), (50, None)])
def test_exploration_costs_no_more_than_the_solve_so_far_or_a_second(
    pairs: int, exploration: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    use_processor_time(monkeypatch)
    result = solve(crossed_pairs(pairs), strategies=rcp.Strategy(exploration=exploration))
    spent = sum(step.seconds for step in explored(result))
    # The clock is read between two linear programs or two runs; both stop by clocks of their own.
    budget = (exploration or 1.0) * (result.seconds - spent)
    assert spent <= (max(EXPLORED_SECONDS, budget) if exploration is None else budget) + 0.5


# ------------------------------------------------------------------------------------------------- no cliff


def test_as_many_linear_programs_for_eighty_pairs_as_for_a_hundred_and_twenty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Counted where each of them costs nothing, so that no budget decides."""
    slow_linear_programs(monkeypatch, longest=0.0)
    programs = count_linear_programs(monkeypatch)
    counts = {}
    for pairs in (80, 120):
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
    def press(program: int) -> None:
        if program == number:
            raise KeyboardInterrupt

    before_linear_programs(monkeypatch, press)


@pytest.mark.parametrize(
    ("name", "backend", "number"),
    [
        ("ralph1", "asl", 0), ("bard1", "asl", 1), ("scholtes4", "asl", 3), (EXPLORED, "asl", 1),
        ("ralph1", "vectorised", 3), (EXPLORED, "vectorised", 0),
    ],
)  # fmt: skip
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
    assert (result.quality, result.certificate) == (rcp.Quality.OPTIMAL, Certificate.PROVEN)
    assert result.largest_natural_residual <= 1e-6


# --------------------------------------------------------------------
# `time_limit` is a law: whatever is solved, it is overrun by one iteration of Ipopt or a second at most.


def overrun(model: pyo.ConcreteModel, limit: float) -> float:
    """By how much a solve exceeds its limit beyond one iteration of Ipopt, on average of a run, or a second."""
    started = time.perf_counter()
    result = solve(model, time_limit=limit)
    elapsed = time.perf_counter() - started
    longest = max((step.seconds / max(step.iterations or 0, 1) for step in result.steps), default=0.0)
    return elapsed - limit - max(1.0, longest)


@pytest.mark.parametrize("name", TIMED_MODELS)
def test_a_limit_of_a_second_is_kept(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """By one of three solves: what shares the memory and the core with this process only adds."""
    use_processor_time(monkeypatch)
    assert any(overrun(TIMED_MODELS[name](), 1.0) <= 0.0 for _ in range(3))


@pytest.mark.parametrize("backend", ["asl", "vectorised"])
def test_slow_linear_programs_of_the_certificate_get_what_is_left(
    backend: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow_linear_programs(monkeypatch, longest=10.0)
    model = mpcc_problem("ralph1").build()
    started = time.perf_counter()
    result = rcp.solve(model, backend=backend, time_limit=1.0, progress=False)
    assert time.perf_counter() - started <= 2.5
    assert result.quality is not rcp.Quality.INFEASIBLE


def test_the_first_strategy_has_all_of_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shares are numbers of iterations: what is solved within a limit does not depend on how fast the machine is."""
    seen = observe_options(monkeypatch)
    assert rcp.solve(crossed_pairs(10), time_limit=1000.0, strategies=rcp.Strategy(exploration=0)).solved
    assert all(900.0 < options["max_wall_time"] <= 1000.0 for options in seen)


def test_the_time_of_linear_programs_is_in_the_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing that takes long is hidden: here they take more than a second."""
    slept: list[float] = []

    def sleep(_program: object) -> None:
        started = time.perf_counter()
        time.sleep(0.15)
        slept.append(time.perf_counter() - started)

    before_linear_programs(monkeypatch, sleep)
    result = rcp.solve(crossed_pairs(30), strategies=rcp.Strategy(exploration=float("inf")), progress=False)
    assert sum(slept) >= 1.0
    assert sum(step.seconds for step in result.steps) >= sum(slept)


# --------------------------------------------------------------------
# Ctrl-C in whatever solves several times: it stops there, and what was found is kept.


@pytest.mark.parametrize("run", [3, 7])
def test_several_starts_end_where_they_were_interrupted(run: int, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = interrupt_run(monkeypatch, run)
    m = mpcc_problem("bard1").build()
    found = rcp.studies.multistart(m, 6, progress=False)
    assert len(runs) == run + 1
    assert len(found) + len(found.remaining) == 6
    assert len(found.remaining) >= 1
    (cost,) = m.component_data_objects(pyo.Objective)
    assert pyo.value(cost) == pytest.approx(found.best.objective)


def test_a_persistent_program_goes_on_after_an_interruption(monkeypatch: pytest.MonkeyPatch) -> None:
    m = pyo.ConcreteModel()
    m.start, m.x = pyo.Param(initialize=1.0, mutable=True), pyo.Var(initialize=0.0)
    m.cost = pyo.Objective(expr=(m.x - m.start) ** 4 + m.x**2)
    kept = PersistentNLP(m)
    assert kept.solve().status.solved
    with monkeypatch.context() as pressed:
        interrupt_run(pressed, 0)
        m.start = 5.0
        assert kept.solve().status is IpoptStatus.INTERRUPTED
    assert kept.solve().status.solved


def test_pyomos_interface_tells_an_interruption(monkeypatch: pytest.MonkeyPatch) -> None:
    interrupt_run(monkeypatch, 0)
    results = SolverFactory("pyrobocop.mpcc").solve(
        mpcc_problem("bard1").build(), load_solutions=False, raise_exception_on_nonoptimal_result=False
    )
    assert results.termination_condition is TerminationCondition.interrupted
