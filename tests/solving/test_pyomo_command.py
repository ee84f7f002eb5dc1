"""The command ``pyomo solve`` with the solver of this package."""

from __future__ import annotations

import json
import logging
import subprocess
import sys

import pyomo.environ as pyo
import pytest
from pyomo.dae import ContinuousSet, DerivativeVar

pytestmark = pytest.mark.casadi

MODEL = """
import pyomo.environ as pyo
from pyomo.mpec import Complementarity, complements

model = pyo.ConcreteModel(name="two corners")
model.x, model.y = pyo.Var(initialize=1, bounds=(0, 4)), pyo.Var(initialize=1, bounds=(0, 4))
model.pair = Complementarity(expr=complements(model.x >= 0, model.y >= 0))
model.row = pyo.Constraint(expr=model.x + model.y >= 1.5)
model.cost = pyo.Objective(expr=model.x**2 + (model.y - 1) ** 2)
"""


@pytest.mark.parametrize("solver", ["mpcc", "ipopt"])
def test_results_and_summary(tmp_path, solver):
    pairs = solver == "mpcc"
    model = MODEL if pairs else "\n".join(line for line in MODEL.splitlines() if "omplement" not in line)
    (tmp_path / "corners.py").write_text(model)
    own = "strategies=barrier" if pairs else "derivatives=casadi"
    command = [
        *(sys.executable, "-c", "from pyomo.scripting.pyomo_main import main; main()"),
        *("solve", f"--solver=pyrobocop.{solver}", "corners.py", "--summary", "--solver-suffix=dual"),
        *("--results-format=json", "--save-results=found.json", f"--solver-options=tol=1e-10 {own} timelimit=60"),
    ]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=900, check=True)
    assert "Number of solutions: 1" in run.stdout
    assert "Status: optimal" in run.stdout
    assert "Model two corners" in run.stdout
    found = json.loads((tmp_path / "found.json").read_text())
    problem, solver, solution = found["Problem"][0], found["Solver"][0], found["Solution"][1]
    assert (problem["Number of variables"], problem["Number of constraints"]) == (2, 1)
    assert solver["Termination condition"] == "optimal"
    assert ("every pair is complementary" if pairs else "satisfies its tolerances") in solver["Message"]
    # Without the pair the cheapest point of x + y = 1.5 is (0.25, 1.25), where both slopes are 0.5.
    assert solution["Variable"]["y"]["Value"] == pytest.approx(1.5 if pairs else 1.25, abs=1e-6)
    assert solution["Objective"]["cost"]["Value"] == pytest.approx(0.25 if pairs else 0.125, abs=1e-6)
    assert solution["Constraint"]["row"]["Dual"] == pytest.approx(1 if pairs else 0.5, abs=1e-4)


def test_options_of_the_command_go_where_they_belong():
    solver = pyo.SolverFactory("pyrobocop.mpcc")
    solver.set_options("tol=1e-9 strategies=barrier timelimit=7 linear_solver=mumps")
    assert solver.config.strategies == "barrier"
    assert solver.config.time_limit == 7
    assert solver.config.solver_options.value() == {"tol": 1e-9, "linear_solver": "mumps"}


def test_solution_of_a_discretised_model(caplog):
    """Every variable has a value at every point; where one has none, Pyomo could not write any, and the log says so."""
    caplog.set_level(logging.INFO)
    m = pyo.ConcreteModel(name="decay")
    m.t = ContinuousSet(bounds=(0, 1))
    m.x, m.u = pyo.Var(m.t, initialize=1), pyo.Var(m.t, initialize=0)
    m.dx = DerivativeVar(m.x)
    m.ode = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] == m.u[t] - m.x[t])
    m.x[0].fix(1)
    m.cost = pyo.Objective(expr=m.x[1] ** 2)
    pyo.TransformationFactory("pyrobocop.collocation").apply_to(m, nfe=2)
    results = pyo.SolverFactory("pyrobocop.mpcc").solve(m)
    pyo.assert_optimal_termination(results)
    m.solutions.store_to(results)
    written = results.solution.variable
    assert written["u[0]"]["Value"] == m.u[0].value
    assert len(written) == len(m.x) + len(m.u)
    m.unused = pyo.Var()
    results = pyo.SolverFactory("pyrobocop.mpcc").solve(m)
    m.solutions.store_to(results)
    assert len(results.solution) == 0
    assert "1 variables have no value, 'unused' among them" in caplog.text
