"""What a walk over a model collects is the model."""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.expression_zoo import ZOO, ZOO_NAMES, cart_pole, long_sums, trees
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.expression_codes import decoded
from pyrobocop_pyomo.programs.model_terms import Terms, collect_terms
from pyrobocop_pyomo.programs.term_groups import Columns


def values_of_rows(terms: Terms, columns: Columns, count: int) -> np.ndarray:
    """The rows from their linear part and their terms, one by one, in plain Python."""
    x, p = [pyo.value(v) for v in columns.variables], [pyo.value(v) for v in columns.parameters]
    rows = np.zeros(count)
    for row, constant in terms.constants.items():
        rows[row] += constant
    for row, column, factor in zip(terms.linear_rows, terms.linear_columns, terms.linear_coefficients, strict=True):
        rows[row] += factor * (x[column] if column >= 0 else p[-1 - column])
    for group in terms.groups.values():
        numbers = list(group.numbers)
        for place, parameter in group.parameters:
            numbers[place] = p[parameter]
        for i, (row, scale) in enumerate(zip(group.rows, group.scales, strict=True)):
            variables = [x[column] for column in group.columns[i * group.size : (i + 1) * group.size]]
            inner = numbers[i * group.numbers_per_term : (i + 1) * group.numbers_per_term]
            rows[row] += scale * decoded(group.code, variables, inner)
    return rows


@pytest.mark.parametrize("build", ZOO, ids=ZOO_NAMES)
def test_plain_evaluation_of_the_terms_gives_every_body(build):
    model = build()
    found = collect_terms(model)
    bodies = [pyo.value(constraint.body) for constraint in found.constraints]
    assert values_of_rows(found.rows, found.columns, len(bodies)) == pytest.approx(bodies, rel=1e-12, abs=1e-12)
    if found.objective is not None:
        cost = values_of_rows(found.cost, found.columns, 1)[0]
        assert cost == pytest.approx(found.sign * pyo.value(found.objective), rel=1e-12, abs=1e-12)


MODEL = pyo.ConcreteModel()
MODEL.x = pyo.Var(range(3), initialize=dict(enumerate((0.3, -0.8, 1.1))))
MODEL.fixed = pyo.Var(initialize=0.6)
MODEL.fixed.fix()
MODEL.p = pyo.Param(initialize=-0.4, mutable=True)
LEAVES = st.one_of(
    st.sampled_from([*MODEL.x.values(), *MODEL.x.values(), MODEL.fixed, MODEL.p]), st.floats(-2, 2), st.integers(-3, 3)
)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(rows=st.lists(trees(LEAVES), min_size=1, max_size=4), scale=st.floats(-3, 3))
def test_random_expressions_keep_their_values(rows, scale):
    columns = Columns()
    terms = Terms(columns)
    for i, row in enumerate(rows):
        terms.add(i, row, scale, keep_constant=True)
    terms.group()
    expected = [scale * pyo.value(row) for row in rows]
    assert values_of_rows(terms, columns, len(rows)) == pytest.approx(expected, rel=1e-10, abs=1e-10)


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
    columns = Columns()
    terms = Terms(columns)
    assert terms.add(0, node)
    terms.group()
    assert len(next(iter(terms.groups))) < 200
    assert values_of_rows(terms, columns, 1)[0] == pytest.approx(plain)


def test_deep_expressions_need_no_recursion():
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=0.5)
    node = m.x
    for _ in range(5000):
        node = pyo.sin(node)
    columns = Columns()
    terms = Terms(columns)
    assert terms.add(0, node)
    terms.group()
    plain = 0.5
    for _ in range(5000):
        plain = np.sin(plain)
    assert values_of_rows(terms, columns, 1)[0] == pytest.approx(plain)


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
