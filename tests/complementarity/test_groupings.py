"""Which products are formed, which share a bound, and what a share of delta amounts to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pyomo.environ as pyo
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pyrobocop_pyomo.complementarity import (
    AllPairs,
    Complementarity,
    Crossed,
    KanzowSchwartz,
    PerPhase,
    Scholtes,
    active_pairs,
    complements,
)
from pyrobocop_pyomo.complementarity.formulation import SMALLEST_SHARE
from pyrobocop_pyomo.errors import ComplementarityError

from .harness import relaxation

amounts = st.lists(st.floats(0.0, 10.0), min_size=8, max_size=8)


def stages(values=(1.0,) * 8):
    """Two elements of two stages."""
    m = pyo.ConcreteModel(name="stages")
    m.I = pyo.Set(initialize=[0, 1])
    m.a = pyo.Var(m.I, m.I, bounds=(0, None), initialize=dict(zip(m.I * m.I, values[:4], strict=True)))
    m.b = pyo.Var(m.I, m.I, bounds=(0, None), initialize=dict(zip(m.I * m.I, values[4:], strict=True)))
    m.cc = Complementarity(
        m.I, m.I, rule=lambda m, i, k: complements(m.a[i, k], m.b[i, k]), group=lambda m, i, k: i, weight=0.5,
        family="stages",
    )  # fmt: skip
    m.cost = pyo.Objective(expr=m.a[0, 0])
    return m


def bodies(m):
    return [pyo.value(row.body) for row in relaxation().relaxed_rows(m)]


@given(values=amounts)
def test_crossed_products_couple_all_stages_of_an_element_and_no_other(values):
    a = {(i, k): values[2 * i + k] for i in (0, 1) for k in (0, 1)}
    b = {(i, k): values[4 + 2 * i + k] for i in (0, 1) for k in (0, 1)}
    expected = {
        "none": [a[i, j] * b[i, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)],
        "stage": [a[i, j] * (b[i, 0] + b[i, 1]) for i in (0, 1) for j in (0, 1)],
        "element": [(a[i, 0] + a[i, 1]) * (b[i, 0] + b[i, 1]) for i in (0, 1)],
    }
    for summed, products in expected.items():
        m = stages(values)
        relaxation().apply_to(m, grouping=Crossed(summed))
        assert bodies(m) == pytest.approx(products, abs=1e-9)


@given(values=amounts)
def test_crossed_products_are_charged_with_the_mean_weight(values):
    m = stages(values)
    token = relaxation().apply_to(m, grouping="crossed", relaxation="penalty", delta=0.25)
    products = sum(values[2 * i + j] * values[4 + 2 * i + k] for i in (0, 1) for j in (0, 1) for k in (0, 1))
    assert pyo.value(token.block.objective) == pytest.approx(values[0] + 0.5 * products / 0.25, abs=1e-9)


def test_fixed_products_that_are_crossed_become_bounds_except_as_one_row():
    for summed, equality in (("none", False), ("stage", False), ("element", True)):
        m = stages()
        relaxation().apply_to(m, grouping=Crossed(summed), relaxation=Scholtes(equality=True))
        assert {row.equality for row in relaxation().relaxed_rows(m)} == {equality}


def test_a_crossed_row_comes_from_the_pairs_of_both_sides():
    m = stages()
    relax = relaxation()
    relax.apply_to(m, grouping="crossed")
    names = {tuple(source.index() for source in relax.get_source(row)) for row in relax.relaxed_rows(m)}
    assert names == {((i, j), (i, k)) if j != k else ((i, j),) for i in (0, 1) for j in (0, 1) for k in (0, 1)}
    assert len(relax.get_rows(m.cc[0, 0])) == 3


def test_pairs_that_come_later_are_crossed_with_those_that_are_there_and_leave_alone():
    m = stages()
    relax = relaxation()
    relax.apply_to(m, grouping="crossed", targets=[m.cc[0, 0], m.cc[1, 1]])
    before = [(row.name, str(row.expr)) for row in relax.relaxed_rows(m)]
    token = relax.apply_to(m)
    assert len(relax.relaxed_rows(m)) == 8
    relax.revert(m, token)
    assert [(row.name, str(row.expr)) for row in relax.relaxed_rows(m)] == before


def test_all_pairs_share_one_row_and_those_of_a_block_one_each():
    m = stages()
    m.part = pyo.Block()
    m.part.cc = Complementarity(expr=complements(m.a[0, 0], m.b[1, 1]))
    groups = {type(g): [[p.name for p in ps] for _, ps in g.groups(active_pairs(m))] for g in (AllPairs(), PerPhase())}
    own = [f"cc[{i},{k}]" for i in (0, 1) for k in (0, 1)]
    assert groups[AllPairs] == [[*own, "part.cc"]]
    assert groups[PerPhase] == [own, ["part.cc"]]


def test_an_unknown_way_to_sum_is_refused():
    with pytest.raises(ComplementarityError, match="summed is 'none', 'stage' or 'element'"):
        Crossed("all")


@dataclass(frozen=True)
class ProductThatCannotBeSummed:
    """Scholtes' residual without its shift: what a group shares then is delta itself."""

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        return a * b - delta

    def shift(self, delta: Any) -> Any:
        return None


@given(values=amounts, delta=st.floats(0.1, 100))
def test_eliminating_the_shares_gives_the_summed_row(values, delta):
    """Shares d_l >= floor with a_l b_l <= d_l and sum d_l <= delta exist where sum max(a_l b_l, floor) <= delta."""
    summed, shared = stages(values), stages(values)
    relaxation().apply_to(summed, grouping="all", delta=delta)
    token = relaxation().apply_to(shared, grouping="all", delta=delta, relaxation=ProductThatCannotBeSummed())
    floor = SMALLEST_SHARE * delta / 4
    shares = list(token.block.shares.values())
    assert [share.lb for share in shares] == pytest.approx([floor] * 4)
    # The smallest shares that the rows of the products allow:
    for row, share in zip(token.block.rows.values(), shares, strict=True):
        share.set_value(0.0)
        share.set_value(max(pyo.value(row.body) - row.ub, floor))
    (budget,) = token.block.budgets.values()
    total = pyo.value(budget.body)
    (body,) = bodies(summed)
    assert body - 1e-9 <= total <= body + SMALLEST_SHARE * delta + 1e-9
    assert budget.ub == delta


def test_shares_follow_delta_and_the_pairs_of_the_group():
    m = stages()
    relax = relaxation()
    relax.apply_to(m, grouping="all", relaxation=KanzowSchwartz(), delta=0.4, targets=[m.cc[0, 0], m.cc[0, 1]])
    block = m.relaxed_complementarity
    assert [share.lb for share in block.shares.values()] == pytest.approx([SMALLEST_SHARE * 0.2] * 2)
    token = relax.apply_to(m)
    assert [share.lb for share in block.shares.values()] == pytest.approx([SMALLEST_SHARE * 0.1] * 4)
    relax.get_delta(m).set_value(0.04)
    assert [share.lb for share in block.shares.values()] == pytest.approx([SMALLEST_SHARE * 0.01] * 4)
    relax.revert(m, token)
    assert len(block.shares) == 2
    assert [share.lb for share in block.shares.values()] == pytest.approx([SMALLEST_SHARE * 0.02] * 2)
