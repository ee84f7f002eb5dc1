"""Expressions: walks over shared nodes, one evaluator for all numbers, what is the same, bounded, or has no value."""

import math
from itertools import combinations

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.expression_zoo import UNARY, trees
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyomo.core.expr.visitor import identify_variables

from pyrobocop_pyomo.modeling.expression_nodes import ARRAY_FUNCTIONS, NUMPY_NAMES
from pyrobocop_pyomo.modeling.expression_steps import ExpressionSteps
from pyrobocop_pyomo.modeling.expressions import ExpressionBounds, never_changes, new_leaves, same_expression
from pyrobocop_pyomo.modeling.row_violations import undefined_part
from pyrobocop_pyomo.modeling.shared_nodes import (
    NodeValues,
    shared_value,
    topmost_nodes,
    variables_in,
    variables_in_any,
)


def model(x=1.0, y=2.0):
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=x), pyo.Var(initialize=y)
    m.p, m.q = pyo.Param(initialize=3, mutable=True), pyo.Param(initialize=3, mutable=True)
    m.c = pyo.Param(initialize=4)
    m.named = pyo.Expression(expr=m.x + m.y)
    return m


def test_what_doubles_in_the_tree_grows_by_one_node():
    m = model()
    node = m.x + m.y
    for _ in range(60):  # the tree has 2**60 nodes
        node = pyo.sin(node * node)
    assert [v.name for v in variables_in(node)] == ["x", "y"]
    assert len(list(topmost_nodes([node], lambda each: each is m.x))) == 1
    assert ExpressionSteps([node]).evaluate_at({}) == [shared_value(node)]


def test_without_a_value_it_is_an_error_or_none_and_nothing_in_the_log(caplog):
    m = model()
    m.y.set_value(None)
    with pytest.raises(ValueError, match=r"No value for uninitialized ScalarVar object y"):
        shared_value(m.y + pyo.sin(m.x))
    with pytest.raises(ValueError, match=r"No value for uninitialized ScalarVar object y"):
        NodeValues().of(m.y)
    assert shared_value(m.y + pyo.sin(m.x), exception=False) is None
    assert caplog.records == []
    m.y.set_value(-1.0)
    with pytest.raises(ValueError, match="math domain"):
        shared_value(pyo.log(m.y))


def test_numbers_that_python_does_not_write():
    m = model()
    assert ExpressionSteps([m.x * math.inf, 3]).evaluate_at({id(m.x): 2.0}) == [math.inf, 3.0]
    assert ExpressionSteps([(-2.0) ** m.x]).evaluate_at({id(m.x): 3.0}) == [-8.0]


# --------------------------------------------------------------------
# One table of nodes and one evaluator for every kind of number.


MODEL = pyo.ConcreteModel()
MODEL.x = pyo.Var(range(3), initialize=dict(enumerate((0.3, -0.8, 1.1))))
MODEL.x[2].fix()
MODEL.p = pyo.Param(initialize=-0.4, mutable=True)
LEAVES = st.one_of(st.sampled_from([*MODEL.x.values(), MODEL.p]), st.floats(-2, 2), st.integers(-3, 3))


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(expression=trees(LEAVES))
def test_variables_and_values_are_those_of_pyomo(expression: object) -> None:
    nodes = [expression, expression * expression + 1, pyo.sin(expression) - expression]
    conditions = MODEL.x[0] == 0.3, MODEL.x[1] <= expression, pyo.inequality(0.5, MODEL.x[2], 1)
    nodes += [pyo.Expr_if(condition, expression, -abs(nodes[1])) for condition in conditions]
    for include_fixed in (True, False):
        expected = [id(v) for v in identify_variables(nodes[-1], include_fixed=include_fixed)]
        assert [id(v) for v in variables_in(nodes[-1], include_fixed=include_fixed)] == expected
    assert set(variables_in_any(nodes)) == {id(v) for node in nodes for v in variables_in(node)}
    values, known = [pyo.value(node) for node in nodes], NodeValues()
    assert [shared_value(node) for node in nodes] == pytest.approx(values, rel=1e-13, abs=1e-13)
    assert [known.of(node) for node in nodes] == pytest.approx(values, rel=1e-13, abs=1e-13)
    assert ExpressionSteps(nodes).evaluate_at({}) == pytest.approx(values, rel=1e-12, abs=1e-12)


@settings(max_examples=50, suppress_health_check=[HealthCheck.too_slow])
@given(expression=trees(LEAVES), seed=st.integers(0, 1000))
def test_arrays_are_evaluated_elementwise(expression: object, seed: int) -> None:
    samples = np.random.default_rng(seed).uniform(-1, 1, (3, 4))
    leaves = {id(variable): samples[i] for i, variable in MODEL.x.items()}
    found = np.broadcast_to(ExpressionSteps([expression]).evaluate_at(leaves, ARRAY_FUNCTIONS)[0], 4)
    for column, value in zip(samples.T, found, strict=True):
        single = {id(variable): float(column[i]) for i, variable in MODEL.x.items()}
        assert value == pytest.approx(ExpressionSteps([expression]).evaluate_at(single)[0], rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("name", UNARY)
def test_every_function_has_its_name_in_numpy(name: str) -> None:
    expression = getattr(pyo, name)(MODEL.x[0])
    array = ExpressionSteps([expression]).evaluate_at({id(MODEL.x[0]): np.array([0.3])}, ARRAY_FUNCTIONS)[0]
    assert array[0] == pytest.approx(pyo.value(expression))


def test_what_cannot_be_evaluated_is_named() -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var()
    m.f = pyo.ExternalFunction(function=lambda x: x)
    with pytest.raises(ValueError, match="'x' has no value"):
        ExpressionSteps([m.x + 1]).evaluate_at({})[0]
    with pytest.raises(ValueError, match="is a ExternalFunctionExpression"):
        ExpressionSteps([m.f(m.x)]).evaluate_at({})[0]
    with pytest.raises(ValueError, match="'tanh'"):
        ExpressionSteps([pyo.tanh(MODEL.x[0])]).evaluate_at({}, {})[0]


# --------------------------------------------------------------------
# Questions about expressions.


BUILT = {
    "variable": lambda m: m.x,
    "other variable": lambda m: m.y,
    "sum": lambda m: m.x + 2 * m.y,
    "other sum": lambda m: m.x + 3 * m.y,
    "parameter": lambda m: m.p * m.x,
    "equal parameter": lambda m: m.q * m.x,
    "sine": lambda m: pyo.sin(m.x),
    "cosine": lambda m: pyo.cos(m.x),
    "named": lambda m: m.named + 1,
    "if": lambda m: pyo.Expr_if(m.x >= 0, m.x, m.y),
    "number": lambda m: 1,
    "float": lambda m: 1.5,
}


@pytest.mark.parametrize("first", BUILT)
@pytest.mark.parametrize("second", BUILT)
def test_expressions_are_the_same_when_they_are_built_alike(first, second):
    m = model()
    assert same_expression(BUILT[first](m), BUILT[second](m)) == (first == second)


def test_only_numbers_and_immutable_parameters_never_change():
    m = model()
    assert never_changes(3.0)
    assert never_changes(m.c)
    assert not never_changes(m.p)
    assert not never_changes(m.c + m.p)
    assert not never_changes(m.x)


def test_leaves_that_were_seen_come_only_once():
    m = model()
    seen = set()
    assert set(map(id, new_leaves([m.x + m.p * m.y], seen))) == {id(m.x), id(m.p), id(m.y)}
    assert list(new_leaves([m.named, 2 * m.y], seen)) == []
    (nan,) = new_leaves([float("nan") * m.x], seen)
    assert nan != nan


# --------------------------------------------------------------------
# Bounds of expressions contain all values, of every function that Pyomo has, on any interval of its variable.


FUNCTIONS = {name: getattr(pyo, name, abs) for name in NUMPY_NAMES} | {
    "root": lambda x: x**0.5,
    "inverse": lambda x: x**-2,
    "cube": lambda x: x**3,
    "power": lambda x: x**x,
    "choice": lambda x: pyo.Expr_if(x >= 0.3, x, -2 * x),
}
ENDS = [-math.inf, -1e200, -800.0, -2.5, -1.0, 0.0, 1.0, 3.0, 800.0, 1e200, math.inf]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_all_values_lie_within(name: str) -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var()
    expression = FUNCTIONS[name](m.x)
    for lower, upper in combinations(ENDS, 2):
        m.x.setlb(lower)
        m.x.setub(upper)
        least, most = ExpressionBounds().walk_expression(expression)
        for number in np.linspace(max(lower, -20.0), min(upper, 20.0), 23).tolist():
            m.x.set_value(number, skip_validation=True)
            try:
                found = pyo.value(expression, exception=False)
            except (ArithmeticError, ValueError):
                continue
            if isinstance(found, float) and math.isfinite(found) and lower <= number <= upper:
                slack = 1e-12 * (1.0 + abs(found))
                assert least - slack <= found <= most + slack, (lower, upper, number)


# --------------------------------------------------------------------
# What has no value is named with its numbers.


def with_values(**values: float) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    for name, number in values.items():
        m.add_component(name, pyo.Var(initialize=number))
    return m


UNDEFINED = {
    "log(...) of x = -0.3": (lambda m: m.y + pyo.log(m.x), -0.3),
    "log10(...) of x = 0": (lambda m: 2 * pyo.log10(m.x), 0.0),
    "sqrt(...) of x = -4": (lambda m: pyo.sqrt(m.x), -4.0),
    "the derivative of sqrt(...) of x = 0": (lambda m: pyo.sqrt(m.x) + m.y, 0.0),
    "division by x = 0": (lambda m: m.y / m.x, 0.0),
    "x = -2 to the power 1.5": (lambda m: m.x**1.5, -2.0),
    "x = 0 to the power -2": (lambda m: m.x**-2, 0.0),
    "the derivative of x = 0 to the power 0.5": (lambda m: m.x**0.5, 0.0),
    "overflow of exp(...) of x = 800": (lambda m: m.y * pyo.exp(m.x), 800.0),
    "asin(...) of x = 1.5": (lambda m: pyo.asin(m.x), 1.5),
    "acosh(...) of x = 0.5": (lambda m: pyo.acosh(m.x), 0.5),
}


@pytest.mark.parametrize("words", UNDEFINED)
def test_the_undefined_part_is_named(words: str) -> None:
    expression, number = UNDEFINED[words]
    m = with_values(x=number, y=1.0)
    body = expression(m)
    part = undefined_part(body)
    assert part is not None
    assert part.what == words


def test_where_everything_has_a_value_nothing_is_found() -> None:
    m = with_values(x=0.5, y=0.0)
    m.shared = pyo.Expression(expr=pyo.log(m.x))
    assert undefined_part(m.shared * m.y + m.shared + pyo.tanh(m.x * 1e9)) is None


def test_the_side_that_a_condition_leaves_out_needs_no_value() -> None:
    m = with_values(x=-0.5, y=2.0)
    assert undefined_part(pyo.Expr_if(m.x > 0, pyo.log(m.x), m.y)) is None
