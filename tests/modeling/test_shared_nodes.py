"""Walks that meet shared nodes once give what Pyomo's walks over trees give."""

import math

import pyomo.environ as pyo
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyomo.core.expr.visitor import identify_variables

from pyrobocop_pyomo.modeling.expression_steps import ExpressionSteps
from pyrobocop_pyomo.modeling.shared_nodes import NodeValues, nodes_of, shared_value, variables_in, variables_in_any


def _model():
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(4), initialize={0: 0.3, 1: -1.2, 2: 0.7, 3: 2.0})
    m.x[2].fix()
    m.q = pyo.Param(initialize=1.7, mutable=True)
    m.named = pyo.Expression(expr=m.x[0] * m.q + 1)
    return m


OPERATIONS = (
    lambda a, b: a + b,
    lambda a, b: a - 2.5 * b,
    lambda a, b: a * b,
    lambda a, b: a / (1 + b**2),
    lambda a, b: pyo.sin(a) + b,
    lambda a, b: pyo.exp(-(a**2)) - b,
    lambda a, b: pyo.sqrt(1 + a**2) * pyo.atan(b),
    lambda a, b: pyo.Expr_if(IF_=a <= b, THEN_=a, ELSE_=b**3),
    lambda a, b: pyo.Expr_if(IF_=pyo.inequality(0.5, a, 1), THEN_=a, ELSE_=b),
    lambda a, b: pyo.Expr_if(IF_=a == 0.3, THEN_=b, ELSE_=a),
    lambda a, b: -abs(a) + 3,
)


@st.composite
def graphs(draw):
    """Expressions made from each other, so that nodes are shared."""
    m = _model()
    nodes = [*m.x.values(), m.q, m.named, 0.5]
    for _ in range(draw(st.integers(1, 9))):
        operation = OPERATIONS[draw(st.integers(0, len(OPERATIONS) - 1))]
        first, second = (nodes[draw(st.integers(0, len(nodes) - 1))] for _ in range(2))
        nodes.append(operation(first, second))
    return m, nodes


@settings(max_examples=40, deadline=None)
@given(graphs())
def test_the_same_variables_values_and_lines_as_pyomo(graph):
    m, nodes = graph
    expression = nodes[-1]
    for include_fixed in (True, False):
        expected = [id(v) for v in identify_variables(expression, include_fixed=include_fixed)]
        assert [id(v) for v in variables_in(expression, include_fixed=include_fixed)] == expected
    assert set(variables_in_any(nodes)) == {id(v) for node in nodes for v in variables_in(node)}
    expected = pyo.value(expression)
    assert shared_value(expression) == pytest.approx(expected, rel=1e-13, abs=1e-13)
    known = NodeValues()
    assert [known.of(node) for node in nodes] == pytest.approx([pyo.value(node) for node in nodes], rel=1e-13)
    steps = ExpressionSteps(nodes)
    m.x[0].set_value(-0.4)
    assert steps.evaluate_at({id(m.x[0]): -0.4, id(m.x[3]): 2.0}) == pytest.approx(
        [pyo.value(node) for node in nodes], rel=1e-13, abs=1e-13
    )


def test_what_doubles_in_the_tree_grows_by_one_node():
    m = _model()
    node = m.x[0] + m.x[1]
    for _ in range(60):  # the tree has 2**60 nodes
        node = pyo.sin(node * node)
    assert [v.name for v in variables_in(node)] == ["x[0]", "x[1]"]
    assert len(list(nodes_of(node))) == 123
    assert ExpressionSteps([node]).evaluate_at({}) == [shared_value(node)]


def test_without_a_value_it_is_an_error_or_none_and_nothing_in_the_log(caplog):
    m = _model()
    m.x[1].set_value(None)
    with pytest.raises(ValueError, match=r"No value for uninitialized VarData object x\[1\]"):
        shared_value(m.x[1] + pyo.sin(m.x[0]))
    with pytest.raises(ValueError, match=r"No value for uninitialized VarData object x\[1\]"):
        NodeValues().of(m.x[1])
    assert shared_value(m.x[1] + pyo.sin(m.x[0]), exception=False) is None
    assert caplog.records == []
    m.x[1].set_value(-1.0)
    with pytest.raises(ValueError, match="math domain"):
        shared_value(pyo.log(m.x[1]))


def test_numbers_that_python_does_not_write():
    m = _model()
    assert ExpressionSteps([m.x[0] * math.inf, 3]).evaluate_at({id(m.x[0]): 2.0}) == [math.inf, 3.0]
    assert ExpressionSteps([(-2.0) ** m.x[0]]).evaluate_at({id(m.x[0]): 3.0}) == [-8.0]
