"""`time_limit` is a law: whatever is solved, it is overrun by one iteration of Ipopt or a second at most.

Time is that of this process, for the deadlines and for the tests: other programs on the machine do not count.
"""

import time
from collections.abc import Iterable
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.observed_runs import (
    before_linear_programs,
    interrupt_run,
    observe_options,
    slow_linear_programs,
    use_processor_time,
)
from harness.timed_models import TIMED_MODELS, TimedModel, crossed_pairs, small_program_without_strong_multipliers
from known_mpccs import mpcc_problem
from pyomo.contrib.solver.common.factory import SolverFactory
from pyomo.contrib.solver.common.results import TerminationCondition

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.ipopt.backends import Backend
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.solving import runner
from pyrobocop_pyomo.solving.procedure import solve_model
from pyrobocop_pyomo.solving.runner import Runner
from pyrobocop_pyomo.solving.settings import Settings
from pyrobocop_pyomo.studies import PersistentNLP

pytestmark = pytest.mark.casadi

every_model = pytest.mark.parametrize("timed", TIMED_MODELS, ids=lambda timed: timed.name)


def longest_iteration(results: Iterable[Any]) -> float:
    """Of one run on average, since a run is cut off after a whole iteration."""
    steps = [step for result in results for step in result.steps]
    return max((step.seconds / max(step.iterations or 0, 1) for step in steps), default=0.0)


def is_kept(timed: TimedModel, limit: float) -> bool:
    """Whether one of three solves keeps the limit: what shares the memory and the core with this process only adds."""
    return any(overrun(timed, limit) <= 0.0 for _ in range(3))


def overrun(timed: TimedModel, limit: float) -> float:
    """By how much one solve exceeds its limit beyond one iteration of Ipopt, in seconds."""
    built = timed.build()
    started = time.perf_counter()
    results = timed.run(built, limit)
    elapsed = time.perf_counter() - started
    allowed = max(1.0, longest_iteration(results))
    return elapsed - timed.solves * (limit + allowed)


@every_model
def test_a_limit_of_a_second_is_kept(timed: TimedModel, monkeypatch: pytest.MonkeyPatch) -> None:
    use_processor_time(monkeypatch)
    assert is_kept(timed, 1.0)


@pytest.mark.parametrize("backend", ["asl", "vectorised"])
def test_slow_linear_programs_of_the_certificate_get_what_is_left(
    backend: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow_linear_programs(monkeypatch, longest=10.0)
    model = small_program_without_strong_multipliers()
    started = time.perf_counter()
    result = rcp.solve(model, backend=backend, time_limit=1.0, progress=False)
    assert time.perf_counter() - started <= 2.5
    assert result.quality is not rcp.Quality.INFEASIBLE


def test_the_first_strategy_has_all_of_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shares are numbers of iterations: what is solved within a limit does not depend on how fast the machine is."""
    seen = observe_options(monkeypatch)
    assert rcp.solve(crossed_pairs(10), time_limit=1000.0, strategies=rcp.Strategy(exploration=0)).solved
    assert all(900.0 < options["max_wall_time"] <= 1000.0 for options in seen)


def test_a_limit_in_the_exploration_keeps_the_optimum() -> None:
    model = crossed_pairs(40)
    result = rcp.solve(model, time_limit=3.0, strategies=rcp.Strategy(exploration=float("inf")), progress=False)
    assert result.quality is not rcp.Quality.INFEASIBLE
    assert model.cost() == pytest.approx(result.objective)


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


def test_no_copy_is_made_where_less_time_is_left_than_the_answer_took(monkeypatch: pytest.MonkeyPatch) -> None:
    """A copy is made as a whole: what is left may not be enough for it, and there is an answer already."""
    made = []
    monkeypatch.setattr(runner, "coarser_copy", lambda *arguments: made.append(arguments))
    settings = Settings("scholtes", "pair", Backend.IN_PROCESS_VECTORISED, deadline=Deadline.after(5.0))
    state = Runner(crossed_pairs(1), settings, solve_model)
    for passed in (1.0, 10.0):
        state.record.started = time.perf_counter() - passed
        assert not state.put_other_optimum()
    assert len(made) == 1


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
