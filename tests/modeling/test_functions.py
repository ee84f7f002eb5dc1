"""Calls of Python functions are expressions of Pyomo like any other, and what is wrong with a function is said."""

import pickle
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pyomo.core.expr.calculus.derivatives import differentiate
from pyomo.core.expr.visitor import identify_variables, polynomial_degree, replace_expressions
from pyomo.repn import generate_standard_repn
from pyomo.util.check_units import assert_units_consistent

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import EvaluationError, FunctionError
from pyrobocop_pyomo.modeling.expression_steps import ExpressionSteps
from pyrobocop_pyomo.modeling.expressions import same_expression


def product(X: np.ndarray) -> np.ndarray:
    return X[:, 0] * np.sin(X[:, 1])


def slopes(X: np.ndarray) -> np.ndarray:
    return np.column_stack([np.sin(X[:, 1]), X[:, 0] * np.cos(X[:, 1])])


def curvatures(X: np.ndarray) -> np.ndarray:
    mixed = np.cos(X[:, 1])
    return np.array([[0 * mixed, mixed], [mixed, -X[:, 0] * np.sin(X[:, 1])]]).transpose(2, 0, 1)


LIFT = rcp.Function(product, slopes, curvatures, inputs=["speed", "angle"], name="lift")
POLAR = rcp.Function(
    lambda X: X[:, :1] * np.column_stack([np.cos(X[:, 1]), np.sin(X[:, 1])]),
    lambda X: np.stack(
        [
            np.column_stack([np.cos(X[:, 1]), -X[:, 0] * np.sin(X[:, 1])]),
            np.column_stack([np.sin(X[:, 1]), X[:, 0] * np.cos(X[:, 1])]),
        ],
        axis=1,
    ),
    outputs=["x", "y"],
    name="polar",
)


def model() -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    m.v, m.a = pyo.Var(initialize=2.0), pyo.Var(initialize=0.5)
    m.p = pyo.Param(initialize=3.0, mutable=True)
    return m


@given(st.floats(-10, 10), st.floats(-10, 10))
@settings(max_examples=20)
def test_a_call_has_the_value_of_the_function(v: float, a: float) -> None:
    m = model()
    m.v, m.a = v, a
    assert pyo.value(2 * LIFT(m.v, m.a + 1)) == pytest.approx(2 * v * np.sin(a + 1), abs=1e-12)
    assert LIFT(v, a) == pytest.approx(pyo.value(LIFT(m.v, m.a)), abs=1e-12)
    assert ExpressionSteps([LIFT(m.v, m.a)]).evaluate_at({id(m.v): v})[0] == pytest.approx(v * np.sin(a), abs=1e-12)


def test_several_outputs_are_a_list_and_lists_of_inputs_are_taken_apart() -> None:
    m = model()
    x, y = POLAR([m.v, m.a])
    assert (pyo.value(x), pyo.value(y)) == pytest.approx((2 * np.cos(0.5), 2 * np.sin(0.5)))
    assert POLAR(np.array([2.0, 0.5])) == pytest.approx([2 * np.cos(0.5), 2 * np.sin(0.5)])
    assert (str(x), str(y)) == ("polar.x(v, a)", "polar.y(v, a)")
    assert not same_expression(x, y)
    assert same_expression(x, POLAR(m.v, m.a)[0])


def test_pyomo_knows_what_a_call_is() -> None:
    m = model()
    call = LIFT(m.v, m.p * m.a)
    assert {v.name for v in identify_variables(call)} == {"v", "a"}
    assert polynomial_degree(call) is None
    assert not generate_standard_repn(call + m.v).is_linear()
    assert pyo.value(replace_expressions(call, {id(m.a): 0.0})) == 0.0
    assert not LIFT(m.p, 2.0).is_potentially_variable()
    m.v.fix()
    m.a.fix()
    assert generate_standard_repn(call).constant == pytest.approx(2 * np.sin(1.5))


def test_clones_and_pickles_call_the_same_function_with_variables_of_their_own() -> None:
    m = model()
    m.e = pyo.Expression(expr=LIFT(m.v, m.a))
    for copied in (m.clone(), pickle.loads(pickle.dumps(m))):
        copied.v = 4.0
        assert pyo.value(copied.e) == pytest.approx(4 * np.sin(0.5))
        assert pyo.value(m.e) == pytest.approx(2 * np.sin(0.5))
    assert m.clone().e.expr._fcn is m.e.expr._fcn


def test_numbers_without_units_are_what_a_function_takes_and_gives() -> None:
    m, u = pyo.ConcreteModel(), pyo.units
    m.v, m.a = pyo.Var(initialize=2.0, units=u.m / u.s), pyo.Var(initialize=0.5, units=u.rad)
    m.row = pyo.Constraint(expr=LIFT(m.v * u.s / u.m, m.a / u.rad) * u.N == 1.0 * u.N)
    assert_units_consistent(m)
    m.wrong = pyo.Constraint(expr=LIFT(m.v, m.a / u.rad) * u.N == 1.0 * u.N)
    with pytest.raises(Exception, match="nconsistent units"):
        assert_units_consistent(m)


def test_pyomo_differentiates_a_call() -> None:
    m = model()
    m.v.set_value(2.0)
    m.a.set_value(0.5)
    found = differentiate(LIFT(m.v, m.a), wrt_list=[m.v, m.a], mode=differentiate.Modes.reverse_numeric)
    assert found == pytest.approx([np.sin(0.5), 2.0 * np.cos(0.5)])


@given(st.lists(st.tuples(st.floats(-3, 3), st.floats(-3, 3)), min_size=1, max_size=4))
@example([(0.0, 5e-324)])
@settings(max_examples=30)
def test_right_derivatives_pass_and_differences_of_the_jacobian_are_the_hessian(points: list) -> None:
    X = np.array(points)
    LIFT.check_derivatives(X)
    POLAR.check_derivatives(X)
    without = rcp.Function(product, slopes)
    np.testing.assert_allclose(without.hessians(X), LIFT.hessians(X), atol=1e-8)


@pytest.mark.parametrize(
    ("jacobian", "hessian", "message"),
    [
        (
            lambda X: 2 * slopes(X),
            None,
            r"'lift': jacobian gives 0\.958\d+ as the derivative by 'speed' at \(speed = 2",
        ),
        (slopes, lambda X: -curvatures(X), r"hessian gives -0\.877\d+ .* by '\w+' and '\w+' .*differences give 0\.877"),
    ],
)
def test_a_wrong_derivative_is_named_with_both_numbers(jacobian: Any, hessian: Any, message: str) -> None:
    wrong = rcp.Function(product, jacobian, hessian, inputs=["speed", "angle"], name="lift")
    with pytest.raises(FunctionError, match=message):
        wrong.check_derivatives(np.array([[2.0, 0.5]]))


@given(st.floats(-1, 1))
@settings(max_examples=10)
def test_a_kink_has_the_derivatives_of_its_sides(side: float) -> None:
    kinked = rcp.Function(lambda X: np.abs(X[:, 0]), lambda X: np.where(X == 0, side, np.sign(X)))
    kinked.check_derivatives(np.array([[0.0], [1.0], [-2.0]]))


@given(st.floats(1.2, 2.0), st.floats(0.01, 100))
@settings(max_examples=20)
def test_a_derivative_may_have_a_kink(power: float, scale: float) -> None:
    drag = rcp.Function(
        lambda X: scale * np.sign(X[:, 0]) * np.abs(X[:, 0]) ** power,
        lambda X: scale * power * np.abs(X) ** (power - 1),
    )
    drag.check_derivatives(np.array([[0.0], [1.0], [-2.0]]))


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (
            rcp.Function(lambda X: X.sum(), slopes, name="f"),
            r"'f': value\(X\) for X of shape \(3, 2\) returned .* \(3, 1\)",
        ),
        (rcp.Function(product, lambda X: slopes(X).T, name="f"), r"jacobian\(X\) .* returned the shape \(2, 3\)"),
        (
            rcp.Function(lambda X: X[:, 0] + X[0, 0], lambda X: slopes(X), name="f"),
            "Each row of X is a point by itself",
        ),
        (rcp.Function(lambda X: X[:, 7], slopes, name="f"), r"'f': value\(X\) raised IndexError"),
        (rcp.Function(lambda X: "text", slopes, name="f"), r"'f': value\(X\) returned a str"),
    ],
)
def test_arrays_of_a_wrong_kind_are_refused(function: rcp.Function, message: str) -> None:
    with pytest.raises(FunctionError, match=message):
        function.check_derivatives(np.arange(6.0).reshape(3, 2) + 1)


def test_what_is_not_finite_is_named() -> None:
    logarithm = rcp.Function(lambda X: np.log(X[:, 0]), lambda X: 1 / X, inputs=["q"], name="ln")
    with pytest.raises(EvaluationError, match=r"'ln': its value is nan at \(q = -1\)"):
        logarithm(-1.0)
    with pytest.raises(EvaluationError, match=r"'ln': its first derivative by 'q' is inf at \(q = 0\)"):
        logarithm.jacobians(np.zeros((1, 1)))


def test_calls_that_make_no_sense_are_refused() -> None:
    m = model()
    m.x = pyo.Var([1, 2])
    for arguments, message in [
        ((m.v,), r"'lift' takes 2 inputs \(speed, angle\), and was called with 1"),
        ((m.x, m.v), r"the input 'x' is indexed.*is \[t\] missing"),
        (("v", m.v), "is no variable, expression"),
        ((m.v <= 1, m.v), "is no variable, expression"),
    ]:
        with pytest.raises(FunctionError, match=message):
            LIFT(*arguments)
    for options, message in [
        ({"outputs": 0}, "at least 1"),
        ({"inputs": ["a", "a"]}, "different names"),
    ]:
        with pytest.raises(FunctionError, match=message):
            rcp.Function(product, slopes, **options)
    with pytest.raises(FunctionError, match="hessian is 3"):
        rcp.Function(product, slopes, 3)
