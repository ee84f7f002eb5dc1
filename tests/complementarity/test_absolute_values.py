"""Absolute values as two parts: the same values, known optima, pairs only where they are needed, and the way back."""

from collections.abc import Callable
from typing import Any

import pyomo.environ as pyo
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpcc_catalogue.point_check import check_point

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ComplementarityError

from .harness import nl_text, state

SPLIT = pyo.TransformationFactory("pyrobocop.absolute_values_to_complementarity")


def kinked() -> pyo.ConcreteModel:
    """Absolute values within each other, in rows of each kind, shared, in a named expression, and two that stay."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=0.3), pyo.Var(initialize=-0.4)
    m.size = pyo.Var(bounds=(1, 2), initialize=1.5)
    m.weight = pyo.Param(initialize=3.0, mutable=True)
    m.distance = pyo.Expression(expr=abs(m.x - 0.5) + abs(m.y))
    m.rows = pyo.ConstraintList()
    m.rows.add(abs(abs(m.x) - 1) + m.distance == 2)
    m.rows.add((-1, m.y - 2 * abs(m.x * m.y), 4))
    m.rows.add(m.weight * abs(m.x) <= m.size)
    m.rows.add(m.x * abs(m.x) + abs(m.size) <= 3)  # stays: a continuous derivative, and a variable above zero
    m.cost = pyo.Objective(expr=m.size * m.distance + (m.x - 2) ** 2)
    return m


def values(m: Any) -> list[float]:
    """Of all rows and objectives that the user wrote."""
    return [*(pyo.value(row.body) for row in m.rows.values()), pyo.value(m.cost)]


@given(x=st.floats(-3, 3), y=st.floats(-3, 3))
def test_with_its_parts_each_row_has_the_value_that_it_had(x: float, y: float) -> None:
    m = kinked()
    m.x, m.y = x, y
    before = values(m)
    token = SPLIT.apply_to(m)
    assert values(m) == pytest.approx(before, abs=1e-12)
    for i, row in token.blocks[0].difference.items():
        assert pyo.value(row.body) == pytest.approx(pyo.value(row.upper), abs=1e-12)
        assert token.blocks[0].positive[i].value * token.blocks[0].negative[i].value == 0.0
        assert min(token.blocks[0].positive[i].value, token.blocks[0].negative[i].value) >= 0.0


def test_the_way_back_is_complete() -> None:
    m = kinked()
    before, text = state(m), nl_text(m)
    token = SPLIT.apply_to(m)
    assert len(token.blocks[0].positive) == 5  # x, |x| - 1, x - 0.5, y, x * y
    assert "abs(" not in "".join(str(m.rows[i].expr) for i in (1, 2, 3)) + str(m.cost.expr)
    assert "abs(" in str(m.rows[4].expr)
    copy = m.clone()
    SPLIT.revert(m, token)
    SPLIT.revert(copy)
    assert state(m) == state(copy) == before
    assert nl_text(m) == nl_text(copy) == text
    with pytest.raises(ComplementarityError, match="nothing to revert"):
        SPLIT.revert(m)


def test_applications_that_build_on_each_other_are_undone_together() -> None:
    m = kinked()
    text = nl_text(m)
    SPLIT.apply_to(m, targets=[m.rows[1]])
    SPLIT.apply_to(m, targets=[m.rows, m.cost])
    SPLIT.revert(m)
    assert nl_text(m) == text


def test_what_holds_none_is_named() -> None:
    m = kinked()
    with pytest.raises(ComplementarityError, match=r"no active row or objective in the targets holds abs"):
        SPLIT.apply_to(m, targets=[m.rows[4]])
    with pytest.raises(ComplementarityError, match="a target is one of Block, Constraint, Objective, or"):
        SPLIT.apply_to(m, targets=[m.x])
    assert m.component("absolute_values_as_pairs") is None


# The statement, and whether a sum of parts above the absolute value could be of use.
USES: dict[str, tuple[Callable[[Any], Any], bool]] = {
    "cost": (lambda m: abs(m.x), False),
    "cost with a number": (lambda m: 3 * (1 + abs(m.x - m.y)) / 2, False),
    "cost with a duration": (lambda m: m.duration * abs(m.x) - m.loss * abs(m.y) / m.duration, False),
    "cost within a sum that is subtracted": (lambda m: m.y**2 - (m.y - 2 * abs(m.x)), False),
    "gain": (lambda m: m.x**2 - abs(m.x), True),
    "cost with a factor of any sign": (lambda m: m.y * abs(m.x) + m.y**2, True),
    "square": (lambda m: (abs(m.x) - 1) ** 2, True),
    "divisor": (lambda m: 1 / (1 + abs(m.x)), True),
    "upper bound": (lambda m: abs(m.x) + m.y <= 1, False),
    "lower bound of minus": (lambda m: m.y - abs(m.x) >= -1, False),
    "lower bound": (lambda m: abs(m.x) >= 1, True),
    "both bounds": (lambda m: (0.5, abs(m.x), 1), True),
    "equation": (lambda m: abs(m.x) == m.y, True),
}


@pytest.mark.parametrize("use", USES)
@pytest.mark.parametrize("mirrored", [False, True])
def test_pairs_are_made_only_where_a_larger_sum_could_be_of_use(use: str, mirrored: bool) -> None:
    statement, needed = USES[use]
    m = pyo.ConcreteModel()
    m.x, m.y, m.duration, m.loss = pyo.Var(), pyo.Var(), pyo.Var(bounds=(1, 2)), pyo.Var(bounds=(-2, 0))
    stated = statement(m)
    if isinstance(stated, tuple) or stated.is_relational():
        m.row = pyo.Constraint(expr=stated)
        m.cost = pyo.Objective(expr=m.x)
    else:
        m.cost = pyo.Objective(expr=-stated if mirrored else stated, sense=pyo.maximize if mirrored else pyo.minimize)
    SPLIT.apply_to(m)
    assert bool(rcp.active_pairs(m)) == needed


@pytest.mark.ipopt
@pytest.mark.parametrize("weight", [0.0, 1.0, 3.0, 5.0, -1.0])
def test_soft_thresholds(weight: float) -> None:
    """``min (x - 2)**2 + w |x|`` is at ``2 - w / 2``, and at zero from ``w = 4`` on."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=1.0)
    m.cost = pyo.Objective(expr=(m.x - 2) ** 2 + weight * abs(m.x))
    token = SPLIT.apply_to(m)
    rcp.solve(m, progress=False).raise_for_status()
    assert m.x.value == pytest.approx(max(2 - weight / 2, 0.0), abs=1e-6)
    parts = pyo.value(token.blocks[0].positive[0] + token.blocks[0].negative[0])
    assert weight == 0.0 or parts == pytest.approx(abs(m.x.value), abs=1e-6)
    SPLIT.revert(m)
    assert pyo.value(m.cost) == pytest.approx((m.x.value - 2) ** 2 + weight * abs(m.x.value))


@pytest.mark.ipopt
@pytest.mark.parametrize("bound", [0.5, 1.0, 2.0])
def test_outside_and_inside_of_a_diamond(bound: float) -> None:
    """The nearest points to (0.8 r, 0) outside of ``|x| + |y| < r`` and to (2 r, 0) inside."""
    for sign, start, distance in ((1, 0.8, 0.2 / 2**0.5), (-1, 2.0, 1.0)):
        m = pyo.ConcreteModel()
        m.x, m.y = pyo.Var(initialize=start * bound), pyo.Var(initialize=0.1 * bound)
        m.outside = pyo.Constraint(expr=sign * (abs(m.x) + abs(m.y) - bound) >= 0)
        m.cost = pyo.Objective(expr=(m.x - start * bound) ** 2 + m.y**2)
        SPLIT.apply_to(m)
        rcp.solve(m, progress=False).raise_for_status()
        SPLIT.revert(m)
        assert pyo.value(m.cost) == pytest.approx((distance * bound) ** 2, rel=1e-5)
        assert check_point(m).violation <= 1e-6
