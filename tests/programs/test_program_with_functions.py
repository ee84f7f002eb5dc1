"""A model with Python functions has the values and derivatives of the same model written in Pyomo."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.expression_zoo import ZOO, ZOO_NAMES, cart_pole, parameters_everywhere, trees
from harness.program_values import InModelOrder, assert_same
from harness.timed_models import example
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyomo.common.errors import InfeasibleConstraintException

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import FunctionError, ModelError
from pyrobocop_pyomo.programs.compiled_model import CompiledModel, KeptProgram

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


def assert_same_programs(first: CompiledModel, second: CompiledModel, seed: int = 0) -> None:
    """Values and derivatives at a random point with random multipliers, in the order of names."""
    random = np.random.default_rng(seed)
    x, multipliers = random.uniform(0.1, 1.0, second.nlp.n), random.normal(size=second.nlp.m)
    one, other = (InModelOrder(compiled).everything(x, 0.7, multipliers) for compiled in (first, second))
    assert_same(one, other, within=1e-12)


@pytest.mark.asl
@pytest.mark.parametrize("sense", [1, -1])
def test_values_and_derivatives_are_those_of_the_model_in_pyomo(sense: int) -> None:
    called, written_out = chain(F, sense=sense), chain(in_pyomo, sense=sense)
    first, second = CompiledModel(called), CompiledModel(written_out, "asl")
    assert_same_programs(first, second)
    for m in (called, written_out):
        m.p, m.x[3].ub = 0.9, 2.0
        m.z.set_value(0.2)
    first.update()
    second.update()
    assert_same_programs(first, second, seed=1)
    for m in (called, written_out):  # now the structure changes
        m.x[2].fix(0.25)
        m.z.unfix()
        m.row[4].deactivate()
    first.update()
    second.update()
    assert_same_programs(first, second, seed=2)


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

    assert_same_programs(CompiledModel(build(F)), CompiledModel(build(in_pyomo), "asl"), seed)


def test_each_function_is_called_once_for_all_points() -> None:
    counts: list[tuple[int, ...]] = []

    def counted(X: np.ndarray) -> np.ndarray:
        counts.append(X.shape)
        return value(X)

    nlp = CompiledModel(chain(rcp.Function(counted, jacobian, hessian, outputs=2, check_derivatives=False))).nlp
    counts.clear()
    x = np.full(nlp.n, 0.4)
    nlp.objective(x), nlp.constraints(x), nlp.gradient(x), nlp.jacobian(x), nlp.hessian(x, 1.0, np.ones(nlp.m))
    # 14 calls of the rows, 16 of the cost, one of the bound and one of what is fixed; then those whose arguments call.
    assert counts == [(32, 2), (14, 2)]


def test_an_argument_that_divides_by_another_call_has_its_value_at_the_first_point() -> None:
    """As a Mach number does, by the speed of sound: before the inner call is evaluated it is no number."""
    m = pyo.ConcreteModel(name="nested")
    m.x = pyo.Var(range(2), initialize=2.0)
    inner, _ = F(m.x[0], m.x[1])
    m.row = pyo.Constraint(expr=F(m.x[1] / inner, 1.0)[0] == 0.5)
    m.cost = pyo.Objective(expr=m.x[0])
    nlp = CompiledModel(m).nlp
    assert np.isfinite(nlp.x_start).all()
    ratio = 2.0 / value(np.array([[2.0, 2.0]]))[0, 0]
    assert np.abs(nlp.x_start - ratio).min() < 1e-12


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


# --------------------------------------------------------------------
# Vectorised expressions against ASL, against finite differences, and after changes of numbers.


def planar_pushing() -> pyo.ConcreteModel:
    model = example("planar_pushing").build(elements=10)
    pyo.TransformationFactory("pyrobocop.relax_complementarity").apply_to(model, delta=1e-2)
    return model


@pytest.mark.asl
@pytest.mark.parametrize("build", [*ZOO, planar_pushing], ids=[*ZOO_NAMES, "planar-pushing"])
def test_every_number_is_that_of_asl(build):
    ours, theirs = InModelOrder(CompiledModel(build(), "vectorised")), InModelOrder(CompiledModel(build(), "asl"))
    assert ours.names == theirs.names
    for rows, columns in (ours.nlp.jacobian_structure, ours.nlp.hessian_structure):  # each place once
        assert len(set(zip(rows.tolist(), columns.tolist(), strict=True))) == rows.size
    assert (ours.nlp.hessian_structure[0] >= ours.nlp.hessian_structure[1]).all()
    random = np.random.default_rng(7)
    for _ in range(3):
        x = random.uniform(0.02, 0.45, ours.nlp.n)
        factor, multipliers = random.uniform(-2, 2), random.uniform(-2, 2, ours.nlp.m)
        assert_same(ours.everything(x, factor, multipliers), theirs.everything(x, factor, multipliers))


MODEL = pyo.ConcreteModel("random")
MODEL.x = pyo.Var(range(4), initialize=0.5)
MODEL.p = pyo.Param(initialize=-0.4, mutable=True)
MODEL.fixed = pyo.Var(initialize=0.6)
MODEL.fixed.fix()
VARIED = st.sampled_from([*MODEL.x.values(), *MODEL.x.values(), MODEL.fixed, MODEL.p])
LEAVES = st.one_of(VARIED, st.floats(-2, 2), st.integers(-3, 3))


@pytest.mark.asl
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(rows=st.lists(trees(LEAVES), min_size=1, max_size=3), seed=st.integers(0, 1000))
def test_random_rows_have_the_derivatives_of_asl(rows, seed):
    MODEL.del_component("rows")
    MODEL.del_component("cost")
    MODEL.rows = pyo.ConstraintList()
    for row in rows:
        MODEL.rows.add((-100, row + MODEL.x[0], 100))
    MODEL.cost = pyo.Objective(expr=sum(v**2 for v in MODEL.x.values()) + rows[0])
    ours, theirs = InModelOrder(CompiledModel(MODEL, "vectorised")), InModelOrder(CompiledModel(MODEL, "asl"))
    random = np.random.default_rng(seed)
    x, multipliers = random.uniform(-1, 1, ours.nlp.n), random.uniform(-2, 2, ours.nlp.m)
    assert_same(ours.everything(x, 0.7, multipliers), theirs.everything(x, 0.7, multipliers))


@pytest.mark.parametrize("build", [parameters_everywhere, lambda: cart_pole(4)], ids=["parameters", "cart-pole"])
def test_refreshed_numbers_are_those_of_a_program_made_anew(build):
    model = build()
    kept = InModelOrder(CompiledModel(model, "vectorised"))
    random = np.random.default_rng(3)
    for component in model.component_data_objects(pyo.Var):
        if component.fixed:
            component.fix(random.uniform(-0.5, 0.5))
        else:
            component.set_value(random.uniform(-0.5, 0.5), skip_validation=True)
    for parameter in model.component_data_objects(pyo.Param):
        parameter.set_value(parameter.value + 0.1)
    free = [v for v in model.component_data_objects(pyo.Var) if not v.fixed]
    free[0].setlb(-77)
    free[1].setub(free[1].ub if free[1].ub is not None else 55)
    free[2].setub(model.component("p")[1] if model.component("p") is not None else 44)
    kept.nlp.refresh()
    anew = InModelOrder(CompiledModel(model, "vectorised"))
    x, multipliers = random.uniform(0, 0.5, anew.nlp.n), random.uniform(-1, 1, anew.nlp.m)
    assert_same(kept.everything(x, 0.3, multipliers), anew.everything(x, 0.3, multipliers))


def test_rows_without_variables_are_checked_at_each_refresh():
    model = parameters_everywhere()
    nlp = CompiledModel(model, "vectorised").nlp
    model.p[0] = 9.0
    with pytest.raises(InfeasibleConstraintException, match="'only_numbers'"):
        nlp.refresh()
    with pytest.raises(InfeasibleConstraintException, match="'only_numbers'"):
        CompiledModel(model, "vectorised")


def replace_a_row(model):
    """As many rows as before, and none of those that are left has changed."""
    expression = model.terms[1].expr
    del model.terms[1]
    model.terms[1] = expression


CHANGES = {
    "fix": lambda m: m.x[0].fix(0.1),
    "unfix": lambda m: m.x[5].unfix(),
    "deactivate one": lambda m: m.terms[2].deactivate(),
    "activate": lambda m: m.sleeping[1].activate(),
    "deactivate all": lambda m: m.terms.deactivate(),
    "add": lambda m: m.add_component("extra", pyo.Constraint(expr=m.x[0] <= 7)),
    "delete": lambda m: m.terms.__delitem__(1),
    "replace": replace_a_row,
    "set": lambda m: m.range.set_value(m.x[0] <= 3),
    "objective": lambda m: m.cost.set_value(m.x[0] ** 2),
    "sense": lambda m: m.cost.set_sense(pyo.maximize),
    "domain": lambda m: setattr(m.x[0], "domain", pyo.NonNegativeReals),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())
def test_changes_of_structure_are_noticed(change):
    model = parameters_everywhere()
    compiled = CompiledModel(model, "vectorised")
    before = compiled.nlp
    change(model)
    with pytest.raises(ModelError, match="'parameters': .* since it was prepared"):
        compiled.nlp.refresh()
    compiled.update()
    assert compiled.nlp is not before
    anew = InModelOrder(CompiledModel(model, "vectorised"))
    assert [v.name for v in compiled.variables] == [v.name for v in anew.compiled.variables]
    assert compiled.row_of[compiled.constraints[-1]] == len(compiled.constraints) - 1


@pytest.mark.parametrize("derivatives", ["vectorised", pytest.param("asl", marks=pytest.mark.asl)])
@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())
def test_a_kept_program_is_that_of_the_model_as_it_is_now(change, derivatives):
    model, kept = parameters_everywhere(), KeptProgram()
    first = kept.of(model, derivatives)
    rows = list(first.constraints)
    model.p[1] = 2.5
    second = kept.of(model, derivatives)
    assert (second is first) == (derivatives == "vectorised")
    change(model)
    third = kept.of(model, derivatives)
    assert third is not second
    # Whoever still holds an earlier one reads what its rows were.
    assert all(a is b for a, b in zip(first.constraints, rows, strict=True))
    anew = CompiledModel(model, derivatives)
    x = anew.current_point()
    assert third.nlp.objective(x) == anew.nlp.objective(x)
    assert np.array_equal(third.nlp.constraints(x), anew.nlp.constraints(x))
    assert np.array_equal(third.nlp.g_upper, anew.nlp.g_upper)


def test_a_kept_program_is_not_that_of_another_model():
    kept = KeptProgram()
    first, second = parameters_everywhere(), parameters_everywhere()
    assert kept.of(first, "vectorised").model is first
    assert kept.of(second, "vectorised").model is second


def test_a_changed_named_expression_is_noticed():
    model = pyo.ConcreteModel("named")
    model.x = pyo.Var(initialize=0.5)
    model.e = pyo.Expression(expr=model.x**2)
    model.row = pyo.Constraint(expr=pyo.sin(model.e) <= 1)
    nlp = CompiledModel(model, "vectorised").nlp
    model.e.set_value(model.x**3)
    with pytest.raises(ModelError, match="named expressions"):
        nlp.refresh()
