"""Values of expressions as arrays are those that Pyomo gives one by one."""

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.expression_zoo import cart_pole, long_sums
from hypothesis import given, settings
from hypothesis import strategies as st

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.row_violations import bound_violation, number_or_nan
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.model_terms import collect_terms
from pyrobocop_pyomo.programs.row_values import RowValues, VariableBounds

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


# --------------------------------------------------------------------
# What a walk over a model collects is the model.


def test_rows_of_one_shape_are_one_group():
    for elements in (5, 50):
        found = collect_terms(cart_pole(elements))
        sizes = sorted(len(group.rows) for group in found.rows.groups.values())
        # Two nonlinear states, and the last point, where the final angle is fixed.
        assert sizes == [1, 1, 3 * elements - 1, 3 * elements - 1]


def test_long_sums_are_taken_apart_and_short_ones_are_not():
    found = collect_terms(long_sums())
    assert max(group.size for group in found.cost.groups.values()) <= 3
    by_row = {row for group in found.rows.groups.values() for row in group.rows if len(group.rows) == 40}
    assert found.constraints[by_row.pop()].name == "row"


def test_common_subexpressions_are_visited_once():
    """A graph of 120 nodes that is a tree of 2**40."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=0.5)
    node, plain = m.x, 0.5
    for _ in range(40):
        node, plain = pyo.cos(node) * node, np.cos(plain) * plain
    assert RowValues([node]).values() == pytest.approx([plain])


def test_deep_expressions_need_no_recursion():
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=0.5)
    node, plain = m.x, 0.5
    for _ in range(5000):
        node, plain = pyo.sin(node), np.sin(plain)
    assert RowValues([node]).values() == pytest.approx([plain])


def test_what_has_no_derivatives_is_refused_by_name():
    m = pyo.ConcreteModel("odd")
    m.x = pyo.Var([1, 2], initialize=1.0)
    m.f = pyo.ExternalFunction(function=lambda x: x, gradient=lambda x: [1.0])
    m.row = pyo.Constraint(expr=m.f(m.x[1]) <= 1)
    with pytest.raises(ModelError, match=r"'row': an expression calls the Python function 'f'.*rcp\.Function"):
        collect_terms(m)
    m.del_component(m.row)
    m.g = pyo.ExternalFunction(library="libm.so.6", function="nothing")
    m.row = pyo.Constraint(expr=m.g(m.x[1]) <= 1)
    with pytest.raises(ModelError, match=r"'row': an expression holds a ExternalFunctionExpression.*derivatives='asl'"):
        collect_terms(m)


def test_components_that_a_solver_would_not_see_are_refused():
    m = pyo.ConcreteModel("contact")
    m.x = pyo.Var([1, 2], initialize=1.0)
    m.row = pyo.Constraint(expr=m.x[1] * m.x[2] <= 1)
    m.one = pyo.SOSConstraint(var=m.x, sos=1)
    with pytest.raises(ModelError, match=r"'one' \(SOSConstraint\)"):
        CompiledModel(m)
