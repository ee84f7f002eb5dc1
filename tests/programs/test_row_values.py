"""Values of expressions as arrays are those that Pyomo gives one by one."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pyrobocop_pyomo.modeling.row_violations import bound_violation, number_or_nan
from pyrobocop_pyomo.modeling.variable_bounds import VariableBounds
from pyrobocop_pyomo.programs.row_values import MANY_TERMS, RowValues, SumValue

FORMS = {
    "linear": lambda m, i: 2.0 * m.x[i] - m.y[i] + 1.0,
    "powers": lambda m, i: m.x[i] ** 2 + m.y[i] ** 1.5 - m.x[i] ** m.y[i],
    "quotients": lambda m, i: m.x[i] / m.y[i] - 1.0 / (m.x[i] - m.p),
    "functions": lambda m, i: pyo.sin(m.x[i]) * pyo.exp(m.y[i]) + pyo.log(m.x[i]) + abs(m.y[i]),
    "shared": lambda m, i: (lambda s: s * s + pyo.cos(s))(m.x[i] * m.y[i] - m.p),
    "choices": lambda m, i: pyo.Expr_if(m.x[i] >= m.y[i], m.x[i], m.p * m.y[i]),
    "named": lambda m, i: m.e[i] ** 2 - m.x[i],
}


def model(count: int = 12) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(range(count), initialize=1.0), pyo.Var(range(count), initialize=2.0)
    m.p = pyo.Param(initialize=3.0, mutable=True)
    m.e = pyo.Expression(range(count), rule=lambda m, i: m.x[i] * m.y[i] + m.p)
    return m


def check(rows: RowValues, expressions: list[Any]) -> None:
    np.testing.assert_allclose(rows.values(), [number_or_nan(e) for e in expressions], rtol=1e-13, atol=1e-13)


VALUES = st.one_of(st.sampled_from([0.0, 1.0, -1.0, 3.0, math.nan, 1e200, None]), st.floats(-5, 5))


@pytest.mark.parametrize("form", FORMS)
@given(values=st.lists(VALUES, min_size=24, max_size=24), fixed=st.sets(st.integers(0, 11)))
@settings(max_examples=25)
def test_arrays_say_what_one_by_one_says(form: str, values: list[float | None], fixed: set[int]) -> None:
    m = model()
    for i in fixed:
        m.x[i].fix()
    expressions = [FORMS[form](m, i) for i in range(12)]
    rows = RowValues(expressions)
    check(rows, expressions)
    for variable, number in zip([*m.x.values(), *m.y.values()], values, strict=True):
        variable.set_value(number, skip_validation=True)
    m.p = 0.5
    check(rows, expressions)


def test_rows_of_all_forms_together() -> None:
    m = model()
    expressions = [form(m, i) for i in range(12) for form in FORMS.values()]
    check(RowValues(expressions), expressions)
    check(RowValues([*expressions, 3.0, m.x[0], m.p]), [*expressions, 3.0, m.x[0], m.p])
    assert RowValues([]).values().size == 0


def test_another_content_of_a_named_expression_is_noticed() -> None:
    m = model()
    rows = RowValues([FORMS["named"](m, i) for i in range(12)])
    assert rows.is_current
    m.e[3].set_value(m.x[3])
    assert not rows.is_current


@given(values=st.lists(VALUES, min_size=6, max_size=6), bound=st.floats(-2, 2))
def test_violated_bounds_of_variables(values: list[float | None], bound: float) -> None:
    m = model(6)
    m.x[1].setlb(0.5)
    m.x[2].setub(m.p)
    m.x[3].domain = pyo.NonNegativeReals
    m.x[4].setlb(-9)
    bounds = VariableBounds([*m.x.values(), *m.y.values()])
    variables = bounds.variables
    assert list(map(id, variables)) == [id(m.x[i]) for i in (1, 2, 3, 4)]
    for _ in range(2):
        for variable, number in zip(variables, values, strict=False):
            variable.set_value(number, skip_validation=True)
        expected = [0.0 if v.value is None else bound_violation(v.value, v.lb, v.ub) for v in variables]
        np.testing.assert_array_equal(bounds.violations(), expected)
        m.p, m.x[4].lower = bound, bound  # what changes between two checks counts


def test_long_sums_in_an_objective_have_the_value_that_pyomo_gives() -> None:
    m = model(MANY_TERMS + 20)
    m.integral = pyo.Expression(expr=m.p * sum(FORMS["powers"](m, i) for i in m.x))
    for expression in (
        m.integral,
        3.0 * m.integral + pyo.sin(m.x[0]),
        m.integral * m.integral - m.p,
        sum(2.0 * m.x[i] for i in m.x) / m.integral,
        pyo.exp(m.x[1]),
        m.x[2],
        4.0,
    ):
        total = SumValue(expression)
        assert total.value() == pytest.approx(pyo.value(expression), rel=1e-13)
        m.x[0] = m.x[0].value + 0.5
        m.p = 2.0
        assert total.value() == pytest.approx(pyo.value(expression), rel=1e-13)


@pytest.mark.parametrize("number", [None, -1.0, math.nan])
def test_a_long_sum_without_a_value_is_not_a_number(number: float | None) -> None:
    m = model(MANY_TERMS)
    total = SumValue(1.0 + sum(pyo.log(m.x[i]) for i in m.x))
    assert total.value() == 1.0
    m.x[7].set_value(number, skip_validation=True)
    assert math.isnan(total.value())


def test_a_named_sum_that_is_given_another_expression_is_noticed() -> None:
    m = model(MANY_TERMS)
    m.integral = pyo.Expression(expr=sum(m.x[i] for i in m.x))
    total = SumValue(2.0 * m.integral)
    assert total.is_current
    m.integral.set_value(m.y[0] + 0.0)
    assert not total.is_current
