"""The procedure in the form of a Pyomo solver, through both of Pyomo's interfaces."""

import io
import json
import subprocess
import sys

import pyomo.environ as pyo
import pytest
from harness.checked import unchanged
from harness.routes import every_backend
from pyomo.contrib.solver.common.factory import SolverFactory
from pyomo.contrib.solver.common.results import SolutionStatus, TerminationCondition
from pyomo.contrib.solver.common.util import NoOptimalSolutionError, NoSolutionError
from pyomo.mpec import Complementarity, ComplementarityList, complements

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import KeywordError
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.mpcc.multipliers import Stationarity

pytestmark = pytest.mark.casadi
ITERATION_LIMIT = {"max_iter": 1}


def two_corners(at_least: float = 1.5) -> pyo.ConcreteModel:
    """Minimise x^2 + (y - 1)^2 with x + y >= 3/2: least where x = 0 and y = 3/2, worse where y = 0."""
    m = pyo.ConcreteModel("two corners")
    m.x = pyo.Var(bounds=(0, 10), initialize=1)
    m.y = pyo.Var(bounds=(0, 10), initialize=2)
    m.idle = pyo.Var()
    m.pair = rcp.Complementarity(expr=rcp.complements(m.x >= 0, m.y >= 0))
    m.row = pyo.Constraint(expr=m.x + m.y >= at_least)
    m.cost = pyo.Objective(expr=m.x**2 + (m.y - 1) ** 2)
    return m


def long_valley() -> pyo.ConcreteModel:
    """The same beside a narrow, curved valley, which takes some dozen iterations whatever becomes of the pair."""
    m = two_corners()
    m.p, m.q = pyo.Var(initialize=-1.2), pyo.Var(initialize=1.0)
    m.cost.set_value(m.cost.expr + (1 - m.p) ** 2 + 100 * (m.q - m.p**2) ** 2)
    return m


def contradiction() -> pyo.ConcreteModel:
    """Where one side is zero, the other violates its row; neither bounds nor fixed variables show it."""
    m = two_corners()
    m.low_x, m.low_y = pyo.Constraint(expr=m.x + m.y**2 >= 200), pyo.Constraint(expr=m.x**2 + m.y >= 200)
    return m


def ruled_out() -> pyo.ConcreteModel:
    """By its bounds neither side can be zero."""
    m = two_corners()
    m.x.setlb(1)
    m.y.setlb(2)
    return m


def without_end() -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=1.0), pyo.Var(initialize=1.0)
    m.cost = pyo.Objective(expr=m.x + m.y**2)
    return m


@pytest.fixture
def m():
    return two_corners()


def solver():
    return SolverFactory("pyrobocop.mpcc")


def legacy(**options):
    return pyo.SolverFactory("pyrobocop.mpcc", **options)


def state(m):
    return [(v.value, v.stale) for v in m.component_data_objects(pyo.Var)]


def test_the_newer_interface_gives_the_whole_answer(m):
    results = solver().solve(m)
    assert (m.x.value, m.y.value) == (0.0, pytest.approx(1.5, abs=1e-6))
    assert results.solution_status is SolutionStatus.optimal
    assert results.termination_condition is TerminationCondition.convergenceCriteriaSatisfied
    assert results.incumbent_objective == pytest.approx(0.25, abs=1e-6)
    answer = results.extra_info.result
    assert isinstance(answer, rcp.SolveResult)
    assert answer.certificate is Certificate.PROVEN
    assert answer.multipliers.kind is Stationarity.S
    assert results.extra_info.iteration_count == answer.iterations > 0
    assert results.solver_name == "pyrobocop.mpcc"
    assert results.solver_version == solver().version()
    assert m.pair.active


def test_the_older_interface_reports_as_pyomo_expects(m):
    assert solver().available()
    assert legacy().available()
    assert legacy().license_is_valid()
    results = legacy().solve(m)
    pyo.assert_optimal_termination(results)
    assert m.y.value == pytest.approx(1.5, abs=1e-6)
    assert results.problem.upper_bound == pytest.approx(0.25, abs=1e-6)


@every_backend
def test_duals_and_reduced_costs_are_prices(m, backend):
    m.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    results = solver().solve(m, backend=backend)
    assert m.dual[m.row] == pytest.approx(1.0, abs=1e-5)  # d/dr (r - 1)^2 at 3/2
    assert results.solution_loader.get_duals([m.row])[m.row] == m.dual[m.row]
    assert results.solution_loader.get_reduced_costs([m.y])[m.y] == pytest.approx(0.0, abs=1e-5)
    assert m.component("rc") is None


def test_unloaded_solutions_leave_the_model_as_it_was_until_they_are_loaded(m):
    m.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    m.dual[m.row] = 7.0
    before = state(m)
    results = solver().solve(m, load_solutions=False)
    assert state(m) == before
    assert dict(m.dual.items()) == {m.row: 7.0}
    loader = results.solution_loader
    assert loader.get_number_of_solutions() == 1
    assert loader.get_vars([m.y])[m.y] == pytest.approx(1.5, abs=1e-6)
    assert state(m) == before
    loader.load_solution()
    assert (m.x.value, m.y.value) == (0.0, pytest.approx(1.5, abs=1e-6))
    assert m.dual[m.row] == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("with_suffix", [False, True])
def test_unloaded_solutions_of_the_older_interface_are_loaded_by_the_model(m, with_suffix):
    if with_suffix:
        m.dual, m.rc = pyo.Suffix(direction=pyo.Suffix.IMPORT), pyo.Suffix(direction=pyo.Suffix.IMPORT)
    before = state(m)
    results = legacy().solve(m, load_solutions=False)
    assert state(m) == before
    m.solutions.load_from(results)
    assert m.y.value == pytest.approx(1.5, abs=1e-6)


def test_a_name_that_is_taken_keeps_its_meaning(m):
    m.dual = pyo.Var(initialize=3)
    results = solver().solve(m)
    assert m.dual.value == 3
    with pytest.raises(NoSolutionError, match="'two corners': multipliers were not kept, since 'dual' is taken"):
        results.solution_loader.get_duals()


@pytest.mark.parametrize(("options", "make"), [(ITERATION_LIMIT, long_valley), ({}, contradiction), ({}, ruled_out)])
def test_what_is_not_solved_is_raised_and_leaves_the_model_as_it_was(options, make):
    m = make()
    m.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    with unchanged(state, m), pytest.raises(NoOptimalSolutionError) as caught:
        solver().solve(m, solver_options=options)
    assert not list(m.dual)
    assert m.pair.active
    answer = caught.value.results.extra_info.result
    assert not answer.solved
    assert answer.stop_reason.value in str(caught.value)


@pytest.mark.parametrize(
    ("make", "options", "limit", "ends"),
    [
        (long_valley, ITERATION_LIMIT, None, "iterationLimit"),
        (contradiction, {}, None, "locallyInfeasible"),
        (ruled_out, {}, None, "locallyInfeasible"),
        (without_end, {}, None, "unbounded"),
        (two_corners, {}, 1e-9, "maxTimeLimit"),
    ],
)
def test_how_a_solve_ended_is_told_in_pyomos_words(make, options, limit, ends):
    results = solver().solve(
        make(), solver_options=options, time_limit=limit, raise_exception_on_nonoptimal_result=False
    )
    assert results.termination_condition is TerminationCondition[ends]
    assert results.solution_status is not SolutionStatus.optimal
    if ends == "locallyInfeasible":
        assert results.solution_status is SolutionStatus.infeasible
        assert results.incumbent_objective is None
    assert not pyo.check_optimal_termination(legacy().solve(make(), options=options, timelimit=limit))


def test_the_log_goes_to_the_streams_that_are_given_and_nowhere_else(capfd):
    stream = io.StringIO()
    solver().solve(two_corners(), tee=[stream])
    assert "EXIT: Optimal Solution Found" in stream.getvalue()
    assert capfd.readouterr().out == ""
    solver().solve(two_corners())
    assert capfd.readouterr().out == ""
    legacy().solve(two_corners(), tee=True)
    assert "EXIT: Optimal Solution Found" in capfd.readouterr().out


def test_choices_are_made_at_the_factory_for_the_older_interface(m):
    chosen = legacy(strategies=rcp.Strategy("continuation", polish=False))
    pyo.assert_optimal_termination(chosen.solve(m))
    assert 0.0 < m.x.value < 1e-6, "without polish the pair is met as its relaxation has it"
    chosen.config.strategies = "continuation"
    chosen.solve(m)
    assert m.x.value == 0.0


@pytest.mark.parametrize(
    ("choice", "words"), [({"strategies": "ladder"}, "unknown strategy 'ladder'"), ({"polsh": 1}, "polsh")]
)
def test_what_is_misspelt_is_refused(choice, words):
    with pytest.raises(ValueError, match=words):
        solver().solve(two_corners(), **choice)


@pytest.mark.parametrize("solve", [rcp.solve, rcp.studies.multistart, lambda m, **given: solver().solve(m, **given)])
def test_a_field_of_a_strategy_is_refused_with_what_to_write(solve):
    with pytest.raises(KeywordError, match=r"Write strategies=rcp\.Strategy\(polish=\.\.\.\)"):
        solve(two_corners(), polish=False)


def test_models_of_pyomo_mpec_are_solved_as_they_are():
    """The nearest point of the L-shaped set to (2, 1), and of a box-complementary variable to its price."""
    m = pyo.ConcreteModel("existing")
    m.x, m.y = pyo.Var(bounds=(0, None), initialize=1), pyo.Var(bounds=(0, None), initialize=1)
    m.z, m.price = pyo.Var(initialize=0.5), pyo.Var(initialize=0.0)
    m.pair = Complementarity(expr=complements(m.x >= 0, m.y >= 0))
    m.several = ComplementarityList()
    m.several.add(complements(pyo.inequality(0, m.z, 1), m.price))
    m.row = pyo.Constraint(expr=m.price == m.z - 3)
    m.cost = pyo.Objective(expr=(m.x - 2) ** 2 + (m.y - 1) ** 2)
    results = solver().solve(m)
    assert results.incumbent_objective == pytest.approx(1.0, abs=1e-6)
    assert (m.x.value, m.y.value) == (pytest.approx(2.0, abs=1e-6), 0.0)
    assert (m.z.value, m.price.value) == (pytest.approx(1.0, abs=1e-6), pytest.approx(-2.0, abs=1e-6))
    assert isinstance(m.pair, Complementarity)


def test_a_block_of_a_model_is_solved_alone():
    m = pyo.ConcreteModel("outer")
    m.b = two_corners()
    m.other = pyo.Var(initialize=9)
    m.other_pair = rcp.Complementarity(expr=rcp.complements(m.other >= 1, m.b.x >= 0))
    solver().solve(m.b)
    assert m.b.y.value == pytest.approx(1.5, abs=1e-6)
    assert m.other.value == 9
    assert m.other_pair.active


# --------------------------------------------------------------------
# The command ``pyomo solve`` with the solver of this package.


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
