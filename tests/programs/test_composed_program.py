"""A model with Python functions has the values and derivatives of the same model written in Pyomo."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.program_values import InModelOrder
from harness.program_values import assert_same as same_values
from hypothesis import given, settings
from hypothesis import strategies as st
from pyomo.common.errors import InfeasibleConstraintException

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import FunctionError, ModelError
from pyrobocop_pyomo.programs.compiled_model import CompiledModel

pytestmark = pytest.mark.casadi


def value(X: np.ndarray) -> np.ndarray:
    a, b = X.T
    return np.column_stack([np.sin(a) * b + a**2, np.exp(a * b / 5)])


def jacobian(X: np.ndarray) -> np.ndarray:
    a, b = X.T
    e = np.exp(a * b / 5) / 5
    return np.array([[np.cos(a) * b + 2 * a, np.sin(a)], [e * b, e * a]]).transpose(2, 0, 1)


def hessian(X: np.ndarray) -> np.ndarray:
    a, b = X.T
    e = np.exp(a * b / 5) / 5
    mixed = e + e * a * b / 5
    return np.array(
        [[[2 - np.sin(a) * b, np.cos(a)], [np.cos(a), 0 * a]], [[e * b**2 / 5, mixed], [mixed, e * a**2 / 5]]]
    ).transpose(3, 0, 1, 2)


F = rcp.Function(value, jacobian, hessian, outputs=2, name="F")


def in_pyomo(a: Any, b: Any) -> tuple[Any, Any]:
    return pyo.sin(a) * b + a**2, pyo.exp(a * b / 5)


def chain(f: Callable[[Any, Any], Any], n: int = 16, nested: bool = True, sense: int = 1) -> pyo.ConcreteModel:
    """Rows that repeat along a chain, with calls of composite, shared, fixed and nested arguments."""
    m = pyo.ConcreteModel(name="chain")
    m.x = pyo.Var(range(n), initialize=lambda m, i: 0.3 + 0.1 * np.sin(i))
    m.p = pyo.Param(initialize=1.3, mutable=True)
    m.z = pyo.Var(initialize=0.7)
    m.z.fix()
    m.only = pyo.Var(initialize=0.4)  # an argument is the only place that has it

    @m.Constraint(range(n - 2))
    def row(m, i):
        u, v = f(m.x[i] * m.x[i + 1] + m.p, pyo.sin(m.x[i]) + m.z)
        w, q = f(u * 0.1 if nested else m.only, m.x[i + 2])
        return (0.0, w * u + pyo.log(v + 3) * m.x[i] + q + f(m.p, m.z)[0] * m.x[i], 8.0)

    m.bound = pyo.Constraint(expr=f(m.x[0], m.only)[0] <= 2 * m.x[1] + 1.5)
    m.cost = pyo.Objective(
        expr=sense * (sum((m.x[i] - 0.5) ** 2 * f(m.x[i], 2.0)[1] for i in m.x) + f(m.p, m.z)[1]) + (m.only - 1) ** 2,
        sense=sense,
    )
    return m


def assert_same(first: CompiledModel, second: CompiledModel, seed: int = 0) -> None:
    """Values and derivatives at a random point with random multipliers, in the order of names."""
    random = np.random.default_rng(seed)
    x, multipliers = random.uniform(0.1, 1.0, first.nlp.n), random.normal(size=first.nlp.m)
    one, other = (InModelOrder(compiled).everything(x, 0.7, multipliers) for compiled in (first, second))
    same_values(one, other, within=1e-12)


@pytest.mark.asl
@pytest.mark.parametrize("sense", [1, -1])
def test_values_and_derivatives_are_those_of_the_model_in_pyomo(sense: int) -> None:
    called, written_out = chain(F, sense=sense), chain(in_pyomo, sense=sense)
    first, second = CompiledModel(called), CompiledModel(written_out, "asl")
    assert_same(first, second)
    for m in (called, written_out):
        m.p, m.x[3].ub = 0.9, 2.0
        m.z.set_value(0.2)
    first.update()
    second.update()
    assert_same(first, second, seed=1)
    for m in (called, written_out):  # now the structure changes
        m.x[2].fix(0.25)
        m.z.unfix()
        m.row[4].deactivate()
    first.update()
    second.update()
    assert_same(first, second, seed=2)


@st.composite
def formulas(draw: Any, depth: int = 3) -> Any:
    """A formula of calls and operators, as a function of what is called and of variables."""
    if depth == 0 or draw(st.booleans()):
        i = draw(st.integers(0, 3))
        return lambda f, x: x[i]
    first, second = draw(formulas(depth - 1)), draw(formulas(depth - 1))
    kind, number = draw(st.integers(0, 4)), draw(st.floats(0.2, 1.5))
    return {
        0: lambda f, x: f(first(f, x), second(f, x) * number)[0] / 3,
        1: lambda f, x: f(first(f, x) / 4, second(f, x) / 4)[1] / 3 + number,
        2: lambda f, x: first(f, x) * second(f, x) * number / 3,
        3: lambda f, x: pyo.sin(first(f, x)) + second(f, x) / (1.0 + number),
        4: lambda f, x: f(number, first(f, x) / 3)[0] - f(first(f, x) / 3, number)[1] / 5,
    }[kind]


@pytest.mark.asl
@given(st.lists(formulas(), min_size=1, max_size=3), st.integers(0, 99))
@settings(max_examples=25)
def test_formulas_at_random_have_the_derivatives_of_pyomo(rows: list[Any], seed: int) -> None:
    def build(f: Any) -> pyo.ConcreteModel:
        m = pyo.ConcreteModel()
        m.x = pyo.Var(range(4), initialize=0.5)
        m.cost = pyo.Objective(expr=rows[0](f, m.x) + sum(m.x[i] ** 2 for i in m.x))
        m.row = pyo.Constraint(range(len(rows)), rule=lambda m, i: rows[i](f, m.x) + m.x[i] <= 1.0)
        return m

    assert_same(CompiledModel(build(F)), CompiledModel(build(in_pyomo), "asl"), seed)


def test_each_function_is_called_once_for_all_points() -> None:
    counts: list[tuple[int, ...]] = []

    def counted(X: np.ndarray) -> np.ndarray:
        counts.append(X.shape)
        return value(X)

    nlp = CompiledModel(chain(rcp.Function(counted, jacobian, hessian, outputs=2, check_derivatives=False))).nlp
    counts.clear()
    x = np.full(nlp.n, 0.4)
    nlp.objective(x), nlp.constraints(x), nlp.gradient(x), nlp.jacobian(x), nlp.hessian(x, 1.0, np.ones(nlp.m))
    # 14 calls of the rows, 16 of the cost and one of the bound; then those whose arguments call.
    assert counts == [(31, 2), (14, 2)]


def test_rows_without_free_variables_are_checked() -> None:
    m = pyo.ConcreteModel()
    m.x, m.fixed = pyo.Var(initialize=0.5), pyo.Var(initialize=0.5)
    m.fixed.fix()
    m.cost = pyo.Objective(expr=m.x**2 + F(1.0, m.fixed)[0])
    m.row = pyo.Constraint(expr=F(m.fixed, 1.0)[0] <= 2.0)
    compiled = CompiledModel(m)
    assert compiled.nlp.m == 0
    assert compiled.nlp.objective(np.array([2.0])) == pytest.approx(4.0 + in_pyomo(1.0, 0.5)[0])
    m.fixed.set_value(2.0)
    with pytest.raises(InfeasibleConstraintException):
        compiled.update()


def test_derivatives_are_checked_when_a_model_is_compiled_and_only_once() -> None:
    wrong = rcp.Function(value, lambda X: 2 * jacobian(X), outputs=["first", "second"], name="wrong")
    with pytest.raises(FunctionError, match=r"'wrong\.first': jacobian gives"):
        CompiledModel(chain(wrong))
    trusted = rcp.Function(value, lambda X: 2 * jacobian(X), outputs=2, check_derivatives=False)
    assert CompiledModel(chain(trusted)).nlp.n > 0


def test_where_derivatives_come_from_is_said() -> None:
    without = rcp.Function(value, jacobian, outputs=2, name="drag")
    text = CompiledModel(chain(without)).nlp.derivatives
    assert text == "CasADi on vectorised expressions, with 'drag' (second derivatives by differences) in Python"


# ---------------------------------------------------------------- refusals


@pytest.mark.parametrize("attached", [True, False])
@pytest.mark.parametrize("backend", ["asl", "vectorised", "executable", None])
@pytest.mark.executable
def test_a_python_function_of_pyomo_is_refused_wherever_it_was_made(attached: bool, backend: str | None) -> None:
    function = pyo.ExternalFunction(lambda x: x**2, lambda x, fixed: [2 * x[0]], lambda x, fixed: [2.0])
    other = pyo.ConcreteModel()
    if attached:
        other.function = function
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=0.5)
    m.cost = pyo.Objective(expr=(m.x - 1) ** 2)
    m.row = pyo.Constraint(expr=function(m.x) <= 0.25)
    with pytest.raises(ModelError, match=r"'row'.* calls the Python function .*rcp\.Function\(value, jacobian"):
        rcp.solve(m, **({} if backend is None else {"backend": backend}))


@pytest.mark.asl
@pytest.mark.executable
@pytest.mark.parametrize("backend", ["asl", "executable"])
def test_programs_from_files_refuse_a_function_by_the_row_that_calls_it(backend: str) -> None:
    m = chain(F)
    components = len(list(m.component_objects()))
    with pytest.raises(FunctionError, match=r"'\w+.*': the Python function 'F\[\d\]' is called, .* in this process"):
        rcp.solve(m, backend=backend)
    assert len(list(m.component_objects())) == components
