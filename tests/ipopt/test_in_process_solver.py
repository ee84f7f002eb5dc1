"""SolverFactory("pyrobocop.ipopt") behaves as Pyomo's own Ipopt interfaces do."""

import copy
import io
import logging
import pickle
import time
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.small_problems import every_derivative, hock_schittkowski_71
from pyomo.contrib.solver.common.factory import SolverFactory as NewSolverFactory
from pyomo.contrib.solver.common.results import SolutionStatus, TerminationCondition
from pyomo.contrib.solver.common.util import NoOptimalSolutionError, NoSolutionError
from pyomo.opt import SolverStatus

from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.ipopt.ipopt_run import KeptProblem, run_ipopt
from pyrobocop_pyomo.programs.compiled_model import CompiledModel

OPTIMUM = 17.0140172891520542
pytestmark = pytest.mark.casadi


@pytest.fixture
def model():
    return hock_schittkowski_71()[0]


def new(**options):
    return NewSolverFactory("pyrobocop.ipopt", derivatives="vectorised", **options)


@every_derivative
def test_results_tell_what_was_done(model, derivatives):
    result = new().solve(model, derivatives=derivatives)
    assert result.termination_condition is TerminationCondition.convergenceCriteriaSatisfied
    assert result.solution_status is SolutionStatus.optimal
    assert result.incumbent_objective == pytest.approx(OPTIMUM)
    assert result.solver_name == "pyrobocop.ipopt"
    assert result.extra_info.derivatives.startswith("ASL" if derivatives == "asl" else "CasADi")
    assert "ipopt" in result.extra_info.ipopt_library
    assert result.extra_info.iteration_count == len(result.extra_info.iteration_log) - 1
    assert result.extra_info.iteration_log[-1].mu < 1e-6
    assert result.extra_info.ipopt_status is IpoptStatus.SOLVED
    assert result.timing_info.timer.get_total_time("ipopt") > 0
    assert not any(variable.stale for variable in model.x.values())


def test_which_ipopt_is_used_is_logged(model, caplog):
    with caplog.at_level(logging.INFO, logger="pyrobocop_pyomo"):
        NewSolverFactory("pyrobocop.ipopt").solve(model)
    assert "'hs71': Ipopt 3." in caplog.text
    assert "derivatives by CasADi on vectorised expressions" in caplog.text


def test_tee_reaches_standard_output_and_nothing_else_does(capsys):
    new().solve(hock_schittkowski_71()[0])
    assert capsys.readouterr().out == ""
    new().solve(hock_schittkowski_71()[0], solver_options={"print_level": 5})
    assert capsys.readouterr().out == ""
    result = new().solve(hock_schittkowski_71()[0], tee=True)
    shown = capsys.readouterr().out
    assert "EXIT: Optimal Solution Found." in shown
    assert result.solver_log.strip() == shown.strip()


def test_tee_reaches_streams_and_loggers(model, caplog):
    stream = io.StringIO()
    with caplog.at_level(logging.INFO):
        new().solve(model, tee=[stream, logging.getLogger("of.the.user")])
    assert "EXIT: Optimal Solution Found." in stream.getvalue()
    assert "EXIT: Optimal Solution Found." in caplog.text


def test_without_loading_the_model_stays_as_it_was(model):
    model.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    before = [variable.value for variable in model.x.values()]
    result = new().solve(model, load_solutions=False)
    assert [variable.value for variable in model.x.values()] == before
    assert len(model.dual) == 0
    assert result.incumbent_objective == pytest.approx(OPTIMUM)
    assert result.solution_loader.get_vars()[model.x[1]] == pytest.approx(1.0, abs=1e-6)
    duals = result.solution_loader.get_duals([model.product])
    assert list(duals) == [model.product]
    result.solution_loader.load_solution()
    assert pyo.value(model.cost) == pytest.approx(OPTIMUM)
    assert model.dual[model.product] == pytest.approx(duals[model.product])


def test_the_older_interface_loads_the_point_of_a_limit(model):
    result = pyo.SolverFactory("pyrobocop.ipopt").solve(model, options={"max_iter": 2})
    assert result.solver.termination_condition == pyo.TerminationCondition.maxIterations
    assert result.solver.status == SolverStatus.aborted
    assert model.x[2].value != 5


def test_the_newer_interface_raises_and_hands_the_results_over(model):
    with pytest.raises(NoOptimalSolutionError, match="iteration limit") as caught:
        new().solve(model, solver_options={"max_iter": 2})
    assert model.x[2].value == 5
    results = caught.value.results
    assert results.termination_condition is TerminationCondition.iterationLimit
    assert results.solution_status is SolutionStatus.unknown
    results.solution_loader.load_vars()
    assert model.x[2].value != 5


def test_a_time_limit_counts_elapsed_seconds(model):
    result = new().solve(
        model, time_limit=0.05, raise_exception_on_nonoptimal_result=False,
        on_iteration=lambda record: time.sleep(0.03),
    )  # fmt: skip
    assert result.termination_condition is TerminationCondition.maxTimeLimit


def test_infeasible_and_unbounded_are_reported():
    model = pyo.ConcreteModel()
    model.x = pyo.Var(initialize=1.0)
    model.cost = pyo.Objective(expr=model.x)
    quiet = {"raise_exception_on_nonoptimal_result": False, "load_solutions": False}
    assert new().solve(model, **quiet).termination_condition is TerminationCondition.unbounded
    model.row = pyo.Constraint(expr=model.x**2 <= -1)
    result = new().solve(model, **quiet)
    assert result.termination_condition is TerminationCondition.locallyInfeasible
    assert result.solution_status is SolutionStatus.infeasible


def test_a_constant_row_that_is_violated_is_proven_infeasible(model):
    model.constant = pyo.Var(initialize=3.0)
    model.constant.fix()
    model.row = pyo.Constraint(expr=model.constant <= 2)
    result = new().solve(model, raise_exception_on_nonoptimal_result=False, load_solutions=False)
    assert result.termination_condition is TerminationCondition.provenInfeasible
    with pytest.raises(NoSolutionError):
        new().solve(model, raise_exception_on_nonoptimal_result=False)


def test_a_callback_that_stops_is_an_interruption(model):
    result = new().solve(model, on_iteration=lambda record: False, raise_exception_on_nonoptimal_result=False)
    assert result.termination_condition is TerminationCondition.interrupted
    assert result.extra_info.ipopt_status is IpoptStatus.STOPPED


def test_an_option_file_is_read(model, tmp_path):
    file = tmp_path / "some.opt"
    file.write_text("max_iter 2\n")
    result = new().solve(
        model, solver_options={"option_file_name": str(file)},
        raise_exception_on_nonoptimal_result=False,
    )  # fmt: skip
    assert result.termination_condition is TerminationCondition.iterationLimit


def test_a_nested_block_is_solved_by_itself():
    model = pyo.ConcreteModel()
    model.outside = pyo.Var(initialize=7.0)
    model.row = pyo.Constraint(expr=model.outside == 1)
    model.part, optimum = hock_schittkowski_71()
    new().solve(model.part)
    assert pyo.value(model.part.cost) == pytest.approx(optimum)
    assert model.outside.value == 7.0


class NotebookStream(io.TextIOBase):
    """As a notebook's: text goes over a socket, yet the stream names the descriptor of the kernel's terminal."""

    def __init__(self):
        self.text = ""

    def write(self, text):
        self.text += text
        return len(text)

    def fileno(self):
        return 1


def test_tee_reaches_a_notebook(model, monkeypatch, capfd):
    stream = NotebookStream()
    monkeypatch.setattr("sys.stdout", stream)
    new().solve(model, tee=True)
    monkeypatch.undo()
    assert "EXIT: Optimal Solution Found." in stream.text
    assert "EXIT" not in capfd.readouterr().out


# --------------------------------------------------------------------
# A problem object that several runs share: each run ends as if it had one of its own.


def program() -> CompiledModel:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(3), initialize=0.5, bounds=(-2, 2))
    m.row = pyo.Constraint(expr=m.x[0] + m.x[1] * m.x[2] == 1)
    m.cost = pyo.Objective(expr=sum((m.x[i] - i) ** 4 for i in range(3)))
    return CompiledModel(m, "vectorised")


def test_runs_share_the_object_end_as_without_it_and_forget_options_of_earlier_ones() -> None:
    nlp, kept = program().nlp, KeptProblem()
    alone = run_ipopt(nlp, {"max_iter": 50})
    first = run_ipopt(nlp, {"max_iter": 50}, kept=kept)
    second = run_ipopt(nlp, {"max_iter": 3}, kept=kept)
    third = run_ipopt(nlp, {}, kept=kept)
    assert (second.iterations, second.status.solved) == (3, False)
    for outcome in (first, third):
        np.testing.assert_array_equal(outcome.x, alone.x)
        assert len(outcome.records) == len(alone.records)


def test_other_bounds_and_other_programs_are_noticed() -> None:
    compiled, kept = program(), KeptProblem()
    run_ipopt(compiled.nlp, {}, kept=kept)
    compiled.variables[0].setlb(0.25)
    compiled.update()
    assert run_ipopt(compiled.nlp, {}, kept=kept).x[0] >= 0.25 - 1e-7
    assert run_ipopt(program().nlp, {}, kept=kept).x[0] < 0.2


def test_a_run_within_a_run_has_an_object_of_its_own() -> None:
    nlp, kept, inner = program().nlp, KeptProblem(), []

    def again(record: Any) -> bool:
        if not inner:
            inner.append(run_ipopt(nlp, {}, kept=kept))
        return True

    outer = run_ipopt(nlp, {}, kept=kept, on_iteration=again)
    np.testing.assert_array_equal(outer.x, inner[0].x)


def test_what_a_callback_raises_spoils_no_later_run() -> None:
    nlp, kept = program().nlp, KeptProblem()

    def fail(record: Any) -> bool:
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        run_ipopt(nlp, {}, kept=kept, on_iteration=fail)
    assert run_ipopt(nlp, {}, kept=kept).status.solved


def test_copies_and_pickles_of_the_object_run_as_it_does() -> None:
    kept = KeptProblem()
    first = run_ipopt(program().nlp, {}, kept=kept)
    for other in (copy.deepcopy(kept), pickle.loads(pickle.dumps(kept))):
        np.testing.assert_array_equal(run_ipopt(program().nlp, {}, kept=other).x, first.x)
