"""Questions about expressions."""

from __future__ import annotations

import pyomo.environ as pyo
import pytest

from pyrobocop_pyomo.modeling.expressions import never_changes, new_leaves, same_expression


def model(x=1.0, y=2.0):
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=x), pyo.Var(initialize=y)
    m.p, m.q = pyo.Param(initialize=3, mutable=True), pyo.Param(initialize=3, mutable=True)
    m.c = pyo.Param(initialize=4)
    m.named = pyo.Expression(expr=m.x + m.y)
    return m


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
