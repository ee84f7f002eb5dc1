"""Shared nodes are written once, and nothing else about a program changes by that."""

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.programs import named_nodes
from pyrobocop_pyomo.programs.compiled_model import CompiledModel

BACKENDS = [pytest.param("asl", marks=pytest.mark.asl), pytest.param("casadi", marks=pytest.mark.casadi)]


def _graph_model(seed, calls=None):
    """Rows and an objective over nodes that are made from each other, so that nearly all are shared and nested."""
    numbers = np.random.default_rng(seed)
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(5), initialize={i: 0.2 + 0.15 * i for i in range(5)})
    m.x[4].fix()
    m.q = pyo.Param(initialize=1.3, mutable=True)
    m.named = pyo.Expression(expr=m.x[0] * m.x[1] + m.q)
    nodes = [*m.x.values(), m.named, m.q * m.x[2]]
    operations = [
        lambda a, b: a + 0.3 * b,
        lambda a, b: a * b,
        lambda a, b: a / (2 + b**2),
        lambda a, b: pyo.sin(a - b) + b,
        lambda a, b: pyo.sqrt(1 + a**2 + b**2),
        lambda a, b: a * m.x[4] + pyo.exp(-(b**2)),
    ]
    if calls is not None:
        operations.append(lambda a, b: calls(a * b) + a)
    for _ in range(14):
        first, second = (nodes[int(k)] for k in numbers.integers(max(0, len(nodes) - 6), len(nodes), 2))
        nodes.append(operations[int(numbers.integers(len(operations)))](first, second))
    m.equality = pyo.Constraint(expr=nodes[-1] == m.q)
    m.range = pyo.Constraint(expr=(-3, nodes[-2] * nodes[-1], 4 * m.q))
    m.off = pyo.Constraint(expr=nodes[-1] <= 0)
    m.off.deactivate()
    m.below = pyo.Constraint(expr=nodes[-3] + nodes[-2] ** 2 <= 5)
    m.linear = pyo.Constraint(expr=m.x[0] - m.x[3] >= -1)
    m.cost = pyo.Objective(expr=nodes[-1] ** 2 + nodes[-4], sense=pyo.maximize)
    return m


def _numbers(model, derivatives):
    """Values and derivatives at a point, by the names of variables and rows."""
    compiled = CompiledModel(model, derivatives)
    nlp, order = compiled.nlp, np.argsort([v.name for v in compiled.variables])
    rows = np.argsort([row.name for row in compiled.constraints])
    x = compiled.current_point()
    weights = np.array([0.3 + 0.1 * len(row.name) for row in compiled.constraints])
    jacobian, hessian = np.zeros((nlp.m, nlp.n)), np.zeros((nlp.n, nlp.n))
    np.add.at(jacobian, nlp.jacobian_structure, nlp.jacobian(x))
    np.add.at(hessian, nlp.hessian_structure, nlp.hessian(x, 0.7, weights))
    hessian = hessian + np.tril(hessian, -1).T
    # A file has the constants of a row in its bounds.
    return [
        nlp.objective(x), nlp.gradient(x)[order], (nlp.constraints(x) - nlp.g_lower)[rows][:1],
        (nlp.g_upper - nlp.constraints(x))[rows], jacobian[np.ix_(rows, order)], hessian[np.ix_(order, order)],
    ]  # fmt: skip


@pytest.mark.casadi
@pytest.mark.parametrize("derivatives", BACKENDS)
@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("calls", [False, True], ids=["formulas", "calls"])
def test_names_change_no_number(derivatives, seed, calls, monkeypatch):
    monkeypatch.setattr(named_nodes, "LEAST_EXCESS", 1)
    tabulated = rcp.Function(lambda X: np.tanh(X[:, 0]), lambda X: 1 / np.cosh(X) ** 2, name="tanh") if calls else None
    model = _graph_model(seed, tabulated)
    assert named_nodes.with_named_nodes(model, model.cost) is not None
    # Where a node is zero, ASL's second derivatives are those of a point 1e-10 beside it.
    for found, expected in zip(_numbers(model, derivatives), _numbers(model, "vectorised"), strict=True):
        assert np.allclose(found, expected, rtol=1e-8, atol=1e-8)


def test_a_model_without_sharing_is_written_as_it_is():
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(300), initialize=1.0)
    m.rows = pyo.Constraint(range(299), rule=lambda m, i: pyo.sin(m.x[i]) * m.x[i + 1] + m.x[i] ** 3 == 0)
    assert named_nodes.with_named_nodes(m, None) is None


@pytest.mark.parametrize("derivatives", BACKENDS)
def test_rows_of_a_rule_are_compiled_by_their_nodes(derivatives):
    """Twelve nested doublings: trees of a hundred thousand nodes, and less than a hundred objects."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(2), initialize={0: 0.4, 1: 0.1})
    node = m.x[0] + m.x[1] ** 2
    for _ in range(16):
        node = pyo.sin(node) * node + 0.1 * node
    m.row = pyo.Constraint(expr=node == 0.1)
    m.cost = pyo.Objective(expr=(m.x[0] - 1) ** 2 + node**2)
    expression = m.row.expr
    nlp = CompiledModel(m, derivatives).nlp
    x = np.array([0.4, 0.1])
    value = 0.4 + 0.01
    for _ in range(16):
        value = np.sin(value) * value + 0.1 * value
    assert nlp.objective(x) == pytest.approx(0.36 + value**2, rel=1e-12)
    assert m.row.expr is expression  # the model keeps what the user wrote
    assert list(m.component_map()) == ["x", "row", "cost"]
