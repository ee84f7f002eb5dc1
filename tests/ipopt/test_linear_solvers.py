"""Ipopt with the linear solver of this package: how it is asked for, what it changes, and what follows a failure."""

import io
import os
import subprocess
import sys

import pyomo.environ as pyo
import pytest
from harness.phases import one_phase
from harness.small_problems import hock_schittkowski_71

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError, SolverNotFoundError
from pyrobocop_pyomo.ipopt import ipopt_run, linear_solver_options, linear_solvers
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.ipopt.linear_solvers import predicted_factor, suits, with_linear_solver
from pyrobocop_pyomo.linear_solver import SymmetricFactorisation, find_linear_solver
from pyrobocop_pyomo.programs.compiled_model import CompiledModel

needs_the_solver = pytest.mark.skipif(find_linear_solver() is None, reason="there is no C compiler")


def with_both(test):
    """The linear solver, and an Ipopt in this process."""
    return needs_the_solver(pytest.mark.casadi(test))


def swing(elements: int = 20) -> pyo.ConcreteModel:
    m, b = one_phase(model="swing", duration=3.0, elements=elements)
    b.angle, b.rate = rcp.State(initial=0, final=3.14), rcp.State(initial=0, final=0)
    b.torque = rcp.Control(bounds=(-3, 3))
    b.ode(lambda b, t: {b.angle: b.rate[t], b.rate: b.torque[t] - 4.9 * pyo.sin(b.angle[t])})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.torque[t] ** 2))
    return m


@with_both
def test_the_answer_is_that_of_mumps():
    nlp = CompiledModel(swing(), "vectorised").nlp
    mumps, own = (ipopt_run.run_ipopt(nlp, {"linear_solver": name}) for name in ("mumps", "ldl"))
    assert (own.status, own.linear_solver, own.fell_back) == (IpoptStatus.SOLVED, "ldl", False)
    assert (mumps.status, mumps.linear_solver) == (IpoptStatus.SOLVED, "")
    assert own.objective == pytest.approx(mumps.objective, rel=1e-9)
    assert own.x == pytest.approx(mumps.x, abs=1e-6)


@with_both
def test_dependent_rows_are_met_as_by_mumps():
    """Ipopt is told that its matrix is singular, and regularises."""
    m = hock_schittkowski_71()[0]
    m.again = pyo.Constraint(expr=2 * sum(m.x[i] ** 2 for i in m.x) == 80)
    m.third = pyo.Constraint(expr=3 * sum(m.x[i] ** 2 for i in m.x) == 120)
    nlp = CompiledModel(m, "casadi").nlp
    outcome = ipopt_run.run_ipopt(nlp, {"linear_solver": "ldl"})
    assert outcome.status.solved
    assert outcome.objective == pytest.approx(17.0140172, rel=1e-6)


@with_both
def test_any_ipopt_loads_it_by_two_options():
    model = hock_schittkowski_71()[0]
    log = io.StringIO()
    pyo.SolverFactory("pyrobocop.ipopt").solve(model, options=linear_solver_options() | {"print_level": 5}, tee=[log])
    assert "ma27" in log.getvalue()
    assert pyo.value(model.cost) == pytest.approx(17.0140172, rel=1e-6)


@needs_the_solver
@pytest.mark.executable
def test_the_executable_loads_it():
    model = hock_schittkowski_71()[0]
    result = rcp.solve(model, backend="executable", options={"linear_solver": "ldl"})
    assert result.solved
    assert result.objective == pytest.approx(17.0140172, rel=1e-6)


@with_both
def test_mumps_has_a_try_where_a_run_fails(monkeypatch):
    """A run whose linear solver breaks down, played by a run that says so."""
    used = []
    once = ipopt_run._run_once

    def failing(nlp, options, *rest, **how):
        used.append(options["linear_solver"])
        outcome = once(nlp, options, *rest, **how)
        return (
            outcome
            if options["linear_solver"] == "mumps"
            else ipopt_run.replace(outcome, status=IpoptStatus.STEP_FAILED)
        )

    monkeypatch.setattr(ipopt_run, "_run_once", failing)
    nlp = CompiledModel(hock_schittkowski_71()[0], "casadi").nlp
    outcome = ipopt_run.run_ipopt(nlp, {"linear_solver": "ldl"})
    assert used == ["ma27", "mumps"]
    assert (outcome.status, outcome.fell_back, outcome.linear_solver) == (IpoptStatus.SOLVED, True, "")


@with_both
def test_the_size_of_the_factor_decides(monkeypatch):
    thin = CompiledModel(swing(), "vectorised").nlp
    size = predicted_factor(thin)
    assert size is not None
    assert size.largest_front < 60
    assert suits(thin)
    dense = pyo.ConcreteModel()
    dense.x = pyo.Var(range(30))
    dense.cost = pyo.Objective(expr=sum(dense.x[i] for i in dense.x) ** 2 + sum(dense.x[i] ** 2 for i in dense.x))
    nlp = CompiledModel(dense, "casadi").nlp
    for name, value in (("LARGEST_FRONT", 20), ("FEW_ENTRIES", 100)):
        monkeypatch.setattr(linear_solvers, name, value)
    assert predicted_factor(nlp).largest_front == 30
    assert not suits(nlp)
    assert suits(thin)
    assert with_linear_solver({"tol": 1e-6}, thin)[0]["linear_solver"] == "ma27"
    assert with_linear_solver({"tol": 1e-6}, nlp) == ({"tol": 1e-6}, False)
    for own in ({"linear_solver": "mumps"}, {"hsllib": "libhsl.so"}, {"linear_solver": "ma57", "hsllib": "libhsl.so"}):
        assert with_linear_solver(own, thin) == (own, False)
    # A dense front of ten thousand rows has more entries than can be counted.
    linear_solvers._size_of_factor.cache_clear()
    monkeypatch.setattr(SymmetricFactorisation, "size_of_factor", lambda *arguments: None)
    assert not suits(nlp)


def test_without_the_solver_nothing_changes_and_asking_for_it_is_refused(monkeypatch):
    monkeypatch.setenv("PYROBOCOP_LINEAR_SOLVER", "none")
    assert with_linear_solver({"tol": 1e-6}) == ({"tol": 1e-6}, False)
    with pytest.raises(SolverNotFoundError, match="C compiler"):
        with_linear_solver({"linear_solver": "ldl"})
    with pytest.raises(ModelError, match="Leave one of both out"):
        with_linear_solver({"linear_solver": "ldl", "hsllib": "libhsl.so"})


@pytest.mark.casadi
@pytest.mark.parametrize("backend", ["casadi", pytest.param("executable", marks=pytest.mark.executable)])
def test_a_linear_solver_whose_library_is_missing_is_named(backend):
    with pytest.raises(ModelError, match="'linear_solver': 'pardiso'.*Its log says.*'mumps' and 'ldl'"):
        rcp.solve(hock_schittkowski_71()[0], options={"linear_solver": "pardiso"}, backend=backend)


@with_both
def test_the_log_begins_with_what_its_names_and_numbers_stand_for():
    log = io.StringIO()
    result = rcp.solve(hock_schittkowski_71()[0], options={"linear_solver": "ldl"}, tee=[log])
    head = log.getvalue().partition("This is Ipopt")[0]
    assert f"the objective divided by {result.scaling.objective:.3g}" in head
    assert "'ma27' below stands for the one of this package ('ldl')" in head
    plain = io.StringIO()
    options = {"linear_solver": "mumps", "nlp_scaling_method": "gradient-based"}
    rcp.solve(hock_schittkowski_71()[0], options=options, tee=[plain])
    assert "stands for" not in plain.getvalue()
    assert "divided" not in plain.getvalue()


# --------------------------------------------------------------------
# Several solves in threads of one process: the same answers, and standard output is there afterwards.


SCRIPT = """
import sys, threading
import pyomo.environ as pyo
import pyrobocop_pyomo as rcp

def solve(number, answers):
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=1), pyo.Var(initialize=1)
    m.pair = rcp.Complementarity(expr=rcp.complements(m.x >= 0, m.y >= 0))
    m.cost = pyo.Objective(expr=(m.x - 1 - number) ** 2 + (m.y - 1) ** 2)
    result = rcp.solve(m, tee=tee and number < 2)
    answers[number] = result.solved and abs(result.objective - 1) < 1e-6

threads, warm, tee = int(sys.argv[1]), "warm" in sys.argv, "tee" in sys.argv
if warm:
    solve(0, {})
for _ in range(2):
    answers = {}
    running = [threading.Thread(target=solve, args=(number, answers)) for number in range(threads)]
    for thread in running:
        thread.start()
    for thread in running:
        thread.join()
print("all solved:", sorted(answers.items()) == [(number, True) for number in range(threads)])
"""


@pytest.mark.ipopt
@pytest.mark.heavy
@pytest.mark.parametrize("words", ["8", "3 warm tee"])
def test_threads_leave_standard_output_and_answers_as_they_are(words: str) -> None:
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT, *words.split()],
        capture_output=True,
        text=True,
        timeout=900,
        check=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    assert run.stdout.splitlines()[-1] == "all solved: True", run.stdout + run.stderr
