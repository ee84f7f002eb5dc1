"""Derivatives against finite differences, and what a shift changes."""

import contextlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pyomo.repn.util
import pytest
from harness.nested_models import EXPANDED, NESTED, differ_from_differences, nested_model
from harness.phases import one_phase
from harness.quadratic_program import QuadraticProgram
from harness.small_problems import every_derivative, every_kind_of_row, maximisation, square_system
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import EvaluationError, ModelError
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import PrimalDualPoint, missing_rank, stationarity
from pyrobocop_pyomo.programs.wrapped_programs import ShiftedRows


def transcendental() -> pyo.ConcreteModel:
    """Every operator that dynamics use, in nonlinear variables, linear ones, and a shared expression."""
    m = pyo.ConcreteModel("transcendental")
    m.x = pyo.Var(range(5), initialize=0.3)
    x = m.x
    m.shared = pyo.Expression(expr=pyo.sin(x[0]) * pyo.exp(x[1]))
    m.cost = pyo.Objective(expr=m.shared**2 + pyo.tanh(x[2]) * x[3] - 3 * x[4], sense=pyo.maximize)
    m.a = pyo.Constraint(expr=m.shared + pyo.log(2 + x[2] ** 2) <= 3)
    m.b = pyo.Constraint(expr=(-1, pyo.sqrt(1 + x[3] ** 2) * pyo.atan(x[0]) + x[4], 2))
    m.c = pyo.Constraint(expr=x[0] / (2 + x[1] ** 2) - 2 * x[4] == 0.5)
    m.d = pyo.Constraint(expr=x[0] + x[4] >= -4)
    return m


points = st.lists(st.floats(-1, 1), min_size=7, max_size=7).map(np.array)
MODELS = [transcendental, every_kind_of_row, lambda: square_system()[0], lambda: maximisation()[0]]


@every_derivative
@pytest.mark.parametrize("build", MODELS, ids=["transcendental", "rows", "square", "maximisation"])
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(point=points, multipliers=points, factor=st.floats(-2, 2))
def test_derivatives_agree_with_finite_differences(build, derivatives, point, multipliers, factor):
    nlp = CompiledModel(build(), derivatives).nlp
    rows, columns = nlp.hessian_structure
    assert (rows >= columns).all()
    assert differ_from_differences(nlp, point[: nlp.n], factor, multipliers[: nlp.m]) == []


@pytest.mark.asl
def test_the_hessian_is_taken_where_it_is_asked_for():
    """ASL by itself takes it where it last evaluated a function."""
    nlp = CompiledModel(transcendental(), "asl").nlp
    here, there = np.full(nlp.n, 0.2), np.full(nlp.n, -0.7)
    multipliers = np.ones(nlp.m)
    expected = nlp.hessian(here, 1.0, multipliers)
    nlp.objective(there)
    nlp.constraints(there)
    assert nlp.hessian(here, 1.0, multipliers) == pytest.approx(expected)


@every_derivative
def test_programs_do_not_disturb_each_other(derivatives):
    first = CompiledModel(transcendental(), derivatives).nlp
    x = np.full(first.n, 0.4)
    value = first.constraints(x).copy()
    second = CompiledModel(every_kind_of_row(), derivatives).nlp
    second.constraints(np.zeros(second.n))
    assert first.constraints(x) == pytest.approx(value)
    assert first.n == 5
    assert second.n == 7


@every_derivative
def test_rows_and_variables_are_in_the_order_of_the_model_lists(derivatives):
    model = transcendental()
    compiled = CompiledModel(model, derivatives)
    x = np.linspace(-0.5, 0.5, compiled.nlp.n)
    compiled.load_point(x)
    assert compiled.current_point() == pytest.approx(x)
    assert compiled.nlp.objective(x) == pytest.approx(-pyo.value(model.cost))
    values = compiled.nlp.constraints(x)
    for constraint, row in compiled.row_of.items():
        upper, lower = compiled.nlp.g_upper[row], compiled.nlp.g_lower[row]
        if constraint.upper is not None:
            assert upper - values[row] == pytest.approx(constraint.uslack())
        if constraint.lower is not None:
            assert values[row] - lower == pytest.approx(constraint.lslack())
        assert (lower == -np.inf) == (constraint.lower is None)
        assert (upper == np.inf) == (constraint.upper is None)


@every_derivative
def test_a_range_is_one_row_and_a_constant_row_is_none(derivatives):
    model = every_kind_of_row()
    model.x[0].fix(1.75)
    model.constant = pyo.Constraint(expr=model.x[0] <= 2)
    compiled = CompiledModel(model, derivatives)
    assert model.range_low in compiled.row_of
    assert model.constant not in compiled.row_of
    assert compiled.nlp.m == len(compiled.constraints) == 5


@every_derivative
def test_a_shift_moves_the_marked_rows_and_nothing_else(derivatives):
    nlp = CompiledModel(transcendental(), derivatives).nlp
    shifted = ShiftedRows(nlp, [1, 3], 0.5)
    x = np.full(nlp.n, 0.3)
    assert shifted.constraints(x) == pytest.approx(nlp.constraints(x))  # first, delta is the base
    shifted.delta = 0.125
    assert shifted.constraints(x) - nlp.constraints(x) == pytest.approx([0, 0.375, 0, 0.375][: nlp.m])
    assert shifted.jacobian(x) == pytest.approx(nlp.jacobian(x))
    assert shifted.hessian(x, 1.0, np.ones(nlp.m)) == pytest.approx(nlp.hessian(x, 1.0, np.ones(nlp.m)))


def test_the_source_of_derivatives_is_checked_by_name():
    with pytest.raises(ValueError, match=r"'finite'; it must be 'asl', 'vectorised' .*'casadi'.* or None"):
        CompiledModel(transcendental(), "finite")


@pytest.mark.asl
@pytest.mark.parametrize("bounds", [(0.0, None), (None, 0.0), (0.0, 3.0)])
def test_a_second_derivative_that_is_infinite_at_a_bound_does_not_end_the_process(bounds: tuple) -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(bounds=bounds, initialize=1.0)
    m.o = pyo.Objective(expr=(m.x if bounds[0] is not None else -m.x) ** 1.75)
    nlp = CompiledModel(m, "asl").nlp
    assert np.isfinite(nlp.hessian(np.zeros(1), 1.0, np.zeros(0))).all()


FUNCTIONS = {
    "sqrt": (pyo.sqrt, -1.0),
    "log": (pyo.log, 0.0),
    "quotient": (lambda x: 1 / x, 0.0),
    "power": (lambda x: x**-1.5, 0.0),
    "exp": (pyo.exp, 800.0),
    "acos": (pyo.acos, 1.5),
    "huge": (lambda x: x**3, 1e200),
}


def one_function(function: Callable[[Any], Any]) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=0.5)
    m.cost = pyo.Objective(expr=function(m.x))
    m.row = pyo.Constraint(expr=function(m.x) + m.x >= 0)
    return m


@every_derivative
@pytest.mark.parametrize(("function", "point"), FUNCTIONS.values(), ids=FUNCTIONS.keys())
def test_what_does_not_exist_is_an_evaluation_error_and_nothing_else(derivatives, function, point):
    nlp = CompiledModel(one_function(function), derivatives).nlp
    x = np.array([point])
    for evaluate in (
        nlp.objective, nlp.gradient, nlp.constraints, nlp.jacobian, lambda x: nlp.hessian(x, 1.0, np.ones(1)),
        lambda x: stationarity(nlp, PrimalDualPoint(x, np.ones(1), np.zeros(1), np.zeros(1)), np.ones(1)),
    ):  # fmt: skip
        with contextlib.suppress(EvaluationError):
            assert np.isfinite(evaluate(x)).all()
    with pytest.raises(EvaluationError, match="objective"):
        nlp.objective(x)
    with pytest.raises(EvaluationError, match="constraints"):
        nlp.constraints(x)


@every_derivative
def test_multipliers_that_overflow_are_an_evaluation_error(derivatives):
    nlp = CompiledModel(one_function(pyo.exp), derivatives).nlp
    with pytest.raises(EvaluationError, match="gradient of the Lagrangian"):
        stationarity(nlp, PrimalDualPoint(np.array([700.0]), np.array([1e300])), np.ones(1))


@pytest.mark.asl
@pytest.mark.parametrize(
    ("function", "point"),
    [(pyo.tanh, 750.0), (pyo.acos, 1.0), (pyo.asin, -1.0), (pyo.acosh, 1.0), (lambda x: (x - 1) ** 1.5, 1.0)],
)
def test_a_second_derivative_that_does_not_exist_does_not_end_the_process(function, point):
    """ASL calls exit() from its Hessian, but tells its gradient about it."""
    nlp = CompiledModel(one_function(function), "asl").nlp
    with pytest.raises(EvaluationError, match="ASL cannot evaluate the gradient"):
        nlp.hessian(np.array([point]), 1.0, np.ones(1))


@pytest.mark.asl
@pytest.mark.parametrize("derivative", ["gradient", "jacobian"])
def test_an_infinite_derivative_is_an_error_and_not_the_end_of_the_process(derivative: str) -> None:
    with pytest.raises(EvaluationError, match="ASL cannot evaluate the"):
        getattr(CompiledModel(one_function(pyo.sqrt), "asl").nlp, derivative)(np.zeros(1))


UNDEFINED = {
    "coefficient": lambda m: m.x / m.p >= 0,
    "term": lambda m: m.x + m.x**2 / m.p >= 0,
    "factor": lambda m: pyo.log(m.p - 1) * m.x >= 0,
    "bound": lambda m: m.x >= 1 / m.p,
    "fixed": lambda m: m.x + pyo.log(m.fixed) >= 0,
    "root": lambda m: m.fixed**0.5 * m.x >= 0,
    "overflow": lambda m: m.x**2 * pyo.exp(1e4 + m.p) >= 0,
    "no variables": lambda m: 1 / m.p >= 1,
}


@every_derivative
@pytest.mark.parametrize("row", UNDEFINED.values(), ids=UNDEFINED.keys())
def test_a_number_that_does_not_exist_is_an_evaluation_error(derivatives, row):
    """Pyomo's writer would leave the term out, and the solver would solve another problem."""
    m = pyo.ConcreteModel("numbers")
    m.x = pyo.Var(initialize=0.5)
    m.p = pyo.Param(initialize=0.0, mutable=True)
    m.fixed = pyo.Var(initialize=-1.0)
    m.fixed.fix()
    m.cost = pyo.Objective(expr=m.x**2)
    m.row = pyo.Constraint(expr=row(m))
    with pytest.raises(EvaluationError) as caught:
        CompiledModel(m, derivatives).nlp.constraints(np.array([0.5]))
    if derivatives != "vectorised":
        assert "in constraint 'row'" in str(caught.value)
    assert pyomo.repn.util.HALT_ON_EVALUATION_ERROR is False


def calling(function: pyo.ExternalFunction) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel("outer")
    m.x = pyo.Var(initialize=0.5)
    m.function = function
    m.cost = pyo.Objective(expr=(m.x - 1) ** 2)
    m.inner = pyo.Block()
    m.inner.expression = pyo.Expression(expr=m.function(m.x))
    m.inner.row = pyo.Constraint(expr=m.inner.expression <= 0.25)
    return m


@pytest.mark.asl
def test_a_python_function_is_refused_before_a_file_is_written():
    """ASL would end the process: it looks for a library that does not exist."""
    m = calling(pyo.ExternalFunction(function=lambda x: x**2, gradient=lambda x: [2 * x], hessian=lambda x: [2]))
    with pytest.raises(ModelError, match=r"'inner\.row' calls the Python function 'function'.*Pyomo expression"):
        CompiledModel(m, "asl")
    m.inner.row.deactivate()
    assert CompiledModel(m, "asl").nlp.m == 0


@pytest.mark.asl
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("library", ["/nowhere/library.so", "libm.so.6"])
def test_a_library_that_asl_would_not_find_is_refused(library):
    with pytest.raises(ModelError, match=rf"calls 'function', whose library '{library}' cannot be loaded"):
        CompiledModel(calling(pyo.ExternalFunction(library=library, function="nothing")), "asl")


# --------------------------------------------------------------------
# Equations that are dependent to first order are counted: the law is the rank of a matrix with generic entries.


@given(st.lists(st.booleans(), min_size=24, max_size=24), st.integers(0, 2**31))
def test_equations_without_a_variable_of_their_own_are_those_that_the_rank_of_generic_entries_lacks(pattern, seed):
    matrix = np.reshape(pattern, (6, 4)) * np.random.default_rng(seed).uniform(1.0, 2.0, (6, 4))
    program = QuadraticProgram(np.zeros(4), A=matrix, g_lower=np.zeros(6), g_upper=[0, 0, 0, 0, 0, 1])
    assert missing_rank(program, np.zeros(4)) == 5 - np.linalg.matrix_rank(matrix[:5])


def thrown(angle: float) -> pyo.ConcreteModel:
    m, b = one_phase(model="thrown", duration=2, elements=6)
    b.x, b.y, b.v = rcp.State(initial=0), rcp.State(initial=0, final=0.1), rcp.State(initial=0)
    b.angle = rcp.Control(bounds=(-3.2, 3.2), initial_guess=angle)

    @b.ode
    def flight(b, t):
        sine, cosine = pyo.sin(b.angle[t]), pyo.cos(b.angle[t])
        return {b.x: b.v[t] * cosine, b.y: b.v[t] * sine, b.v: 0.5 - sine}

    m.range = pyo.Objective(expr=b.x.at_end, sense=pyo.maximize)
    return m


@pytest.mark.casadi
def test_a_motion_at_rest_cannot_be_steered():
    for angle, dependent in ((0.0, 1), (0.3, 0)):
        compiled = CompiledModel(thrown(angle), "vectorised")
        assert missing_rank(compiled.nlp, compiled.current_point()) == dependent


@pytest.mark.ipopt
@pytest.mark.casadi
def test_a_solve_starts_from_the_motion_where_equations_depend_at_the_initial_guess():
    assert rcp.solve(thrown(0.0), backend="vectorised").steps[0].label == "simulated"
    assert rcp.solve(thrown(0.3), backend="vectorised").steps[0].label == "solve"
    chosen = rcp.solve(thrown(0.0), backend="vectorised", strategies="solve")
    assert [step.label for step in chosen.steps] == ["solve"]


# --------------------------------------------------------------------
# Derivatives of models whose Expressions use each other, by every source of derivatives.


@pytest.mark.heavy
@pytest.mark.parametrize(
    "derivatives",
    [pytest.param("asl", marks=pytest.mark.asl), pytest.param("vectorised", marks=pytest.mark.casadi)],
)
def test_derivatives_are_those_of_the_functions(derivatives):
    """The first models are those that the library of 2019 gets wrong as Pyomo writes them, or even written out."""
    for seed in (*NESTED, *EXPANDED, *range(20)):
        compiled = CompiledModel(nested_model(seed), derivatives)
        assert differ_from_differences(compiled.nlp, compiled.current_point()) == [], seed


@pytest.mark.parametrize("wrong", ["gradient", "Jacobian", "Hessian"])
def test_the_check_notices_each_kind_of_wrong_derivative(wrong):
    program = QuadraticProgram([1.0, 2.0], H=[[2.0, 1.0], [1.0, 3.0]], A=[[1.0, -1.0]])
    x = np.array([0.7, 1.1])
    assert differ_from_differences(program, x) == []
    right = getattr(program, wrong.lower())
    setattr(program, wrong.lower(), lambda *given: right(*given) + 1e-3)
    assert wrong in differ_from_differences(program, x)
