"""What has no value is named with its numbers, and can be moved to where it has one."""

from __future__ import annotations

import math

import pyomo.environ as pyo
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pyrobocop_pyomo.modeling.undefined_values import moved_into_domain, undefined_part


def _model(**values: float) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    for name, number in values.items():
        m.add_component(name, pyo.Var(initialize=number))
    return m


CASES = {
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


@pytest.mark.parametrize("words", CASES)
def test_the_undefined_part_is_named_and_can_be_left(words: str) -> None:
    expression, number = CASES[words]
    m = _model(x=number, y=1.0)
    body = expression(m)
    part = undefined_part(body)
    assert part is not None
    assert part.what == words
    assert moved_into_domain(part)
    assert math.isfinite(pyo.value(body))
    assert undefined_part(body) is None


@given(x=st.floats(-3, 3), y=st.floats(-3, 3))
def test_an_argument_moves_into_a_disc_and_no_further_than_needed(x: float, y: float) -> None:
    m = _model(x=x, y=y)
    body = pyo.sqrt(1 - m.x**2 - m.y**2)
    part = undefined_part(body)
    if x**2 + y**2 < 0.99:
        assert part is None
    elif x**2 + y**2 > 1.01:
        assert part is not None
        assert moved_into_domain(part)
        assert 0.9 <= math.hypot(m.x.value, m.y.value) < 1.0


def test_where_everything_has_a_value_nothing_is_found() -> None:
    m = _model(x=0.5, y=0.0)
    m.shared = pyo.Expression(expr=pyo.log(m.x))
    assert undefined_part(m.shared * m.y + m.shared + pyo.tanh(m.x * 1e9)) is None


def test_the_side_that_a_condition_leaves_out_needs_no_value() -> None:
    m = _model(x=-0.5, y=2.0)
    assert undefined_part(pyo.Expr_if(m.x > 0, pyo.log(m.x), m.y)) is None


def test_bounds_of_variables_are_kept() -> None:
    m = _model(x=0.0, y=0.0)
    m.x.setub(0.05)
    part = undefined_part(pyo.log(m.x + m.y))
    assert part is not None
    assert moved_into_domain(part)
    assert m.x.value <= 0.05
    assert m.x.value + m.y.value > 0.0
