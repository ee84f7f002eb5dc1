"""Which products are formed, which share a bound, and what a share of delta amounts to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pyomo.environ as pyo
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyomo.dae import ContinuousSet, DerivativeVar

import pyrobocop_pyomo as rcp
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
from pyrobocop_pyomo.complementarity.group_rows import SMALLEST_SHARE
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
    return [pyo.value(row.body) for row in relaxation().shifted_rows_of(m)]


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
def test_crossed_products_are_penalised_with_the_mean_weight(values):
    m = stages(values)
    token = relaxation().apply_to(m, grouping="crossed", relaxation="penalty", delta=0.25)
    products = sum(values[2 * i + j] * values[4 + 2 * i + k] for i in (0, 1) for j in (0, 1) for k in (0, 1))
    assert pyo.value(token.block.objective) == pytest.approx(values[0] + 0.5 * products / 0.25, abs=1e-9)


def test_fixed_products_that_are_crossed_become_bounds_except_as_one_row():
    for summed, equality in (("none", False), ("stage", False), ("element", True)):
        m = stages()
        relaxation().apply_to(m, grouping=Crossed(summed), relaxation=Scholtes(equality=True))
        assert {row.equality for row in relaxation().shifted_rows_of(m)} == {equality}


def test_a_crossed_row_comes_from_the_pairs_of_both_sides():
    m = stages()
    relax = relaxation()
    relax.apply_to(m, grouping="crossed")
    names = {tuple(source.index() for source in relax.sources_of(row)) for row in relax.shifted_rows_of(m)}
    assert names == {((i, j), (i, k)) if j != k else ((i, j),) for i in (0, 1) for j in (0, 1) for k in (0, 1)}
    assert len(relax.rows_of(m.cc[0, 0])) == 3


def test_pairs_that_come_later_are_crossed_with_those_that_are_there_and_leave_alone():
    m = stages()
    relax = relaxation()
    relax.apply_to(m, grouping="crossed", targets=[m.cc[0, 0], m.cc[1, 1]])
    before = [(row.name, str(row.expr)) for row in relax.shifted_rows_of(m)]
    token = relax.apply_to(m)
    assert len(relax.shifted_rows_of(m)) == 8
    relax.revert(m, token)
    assert [(row.name, str(row.expr)) for row in relax.shifted_rows_of(m)] == before


def test_all_pairs_share_one_row_and_those_of_a_block_one_each():
    m = stages()
    m.part = pyo.Block()
    m.part.cc = Complementarity(expr=complements(m.a[0, 0], m.b[1, 1]))
    groups = {type(g): [[p.name for p in ps] for _, ps in g.groups(active_pairs(m))] for g in (AllPairs(), PerPhase())}
    own = [f"cc[{i},{k}]" for i in (0, 1) for k in (0, 1)]
    assert groups[AllPairs] == [[*own, "part.cc"]]
    assert groups[PerPhase] == [own, ["part.cc"]]


def test_an_unknown_way_to_sum_or_to_begin_is_refused():
    with pytest.raises(ComplementarityError, match="summed is 'none', 'stage' or 'element'"):
        Crossed("all")
    with pytest.raises(ComplementarityError, match="left_end is None, 'first' or 'second'"):
        Crossed(left_end="a")


def phase(elements=3, stages=2, statements=2):
    """A rule that returns a list: one component, several statements at each time."""
    m = pyo.ConcreteModel(name="listed")
    m.phase = b = rcp.PhaseBlock(duration=1.0, elements=elements, stages=stages)
    for i in range(statements):
        b.declare(f"a{i}", rcp.Algebraic(bounds=(0, None), initial_guess=lambda t, i=i: 1 + i + t))
        b.declare(f"b{i}", rcp.Algebraic(bounds=(0, None), initial_guess=lambda t, i=i: 2 - i / 3 - t))

    @b.complementarity
    def both(b, t):
        return [complements(getattr(b, f"a{i}")[t], getattr(b, f"b{i}")[t]) for i in range(statements)]

    m.cost = pyo.Objective(expr=b.a0[b.points.first()])
    return m


crossings = st.builds(
    Crossed, summed=st.sampled_from(["none", "stage", "element"]), left_end=st.sampled_from([None, "first", "second"])
)


@given(grouping=crossings, elements=st.integers(1, 3), stages=st.integers(1, 3), statements=st.integers(1, 3))
def test_crossed_products_are_of_one_statement_and_hold_each_pair(grouping, elements, stages, statements):
    m = phase(elements, stages, statements)
    pairs = active_pairs(m)
    last = {pair.group: pair.source.index()[0] for pair in pairs}
    products = [
        (a, b)
        for _, group in grouping.groups(pairs)
        for row in grouping.products(group)
        for a_pairs, b_pairs in row
        for a in a_pairs
        for b in b_pairs
    ]
    for a, b in products:
        assert a.source.index()[1:] == b.source.index()[1:]
        earlier, later = (a, b) if grouping.left_end == "first" else (b, a)
        if a.group != b.group:
            assert grouping.left_end is not None
            assert earlier.group == later.group - 1
            assert earlier.source.index()[0] == last[earlier.group]
    formed = {(id(a), id(b)) for a, b in products}
    assert len(formed) == len(products)  # each once
    assert {(id(pair), id(pair)) for pair in pairs} <= formed
    ends = 0 if grouping.left_end is None else (elements - 1) * stages
    assert len(formed) == statements * (elements * stages**2 + ends)


@pytest.mark.parametrize("summed", ["none", "stage", "element"])
def test_with_one_stage_and_no_left_end_crossed_is_pair_by_pair(summed):
    written = []
    for grouping in (Crossed(summed), "pair"):
        m = phase(elements=4, stages=1)
        relaxation().apply_to(m, grouping=grouping)
        written.append(sorted(str(row.expr) for row in relaxation().shifted_rows_of(m)))
    assert written[0] == written[1]


@given(values=amounts)
def test_the_left_end_is_the_last_stage_of_the_element_before(values):
    a = {(i, k): values[2 * i + k] for i in (0, 1) for k in (0, 1)}
    b = {(i, k): values[4 + 2 * i + k] for i in (0, 1) for k in (0, 1)}
    inside = [a[i, j] * b[i, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    for left_end, across in (
        ("first", [a[0, 1] * b[1, 0], a[0, 1] * b[1, 1]]),
        ("second", [a[1, 0] * b[0, 1], a[1, 1] * b[0, 1]]),
    ):
        m = stages(values)
        relaxation().apply_to(m, grouping=Crossed(left_end=left_end))
        assert sorted(bodies(m)) == pytest.approx(sorted(inside + across), abs=1e-9)
        m = stages(values)
        relaxation().apply_to(m, grouping=Crossed("element", left_end=left_end))
        longer, shorter = (a, b) if left_end == "first" else (b, a)
        second = (longer[0, 1] + longer[1, 0] + longer[1, 1]) * (shorter[1, 0] + shorter[1, 1])
        first = (a[0, 0] + a[0, 1]) * (b[0, 0] + b[0, 1])
        assert bodies(m) == pytest.approx([first, second], abs=1e-9)


@pytest.mark.parametrize("left_end", ["first", "second"])
def test_left_ends_do_not_depend_on_the_order_in_which_pairs_came(left_end):
    m = phase()
    relax = relaxation()
    later = [pair.source for pair in active_pairs(m) if pair.group == 1]
    relax.apply_to(
        m, grouping=Crossed(left_end=left_end), targets=[pair for pair in m.phase.both.values() if pair not in later]
    )
    apart = sorted(str(row.expr) for row in relax.shifted_rows_of(m))
    assert len(apart) == 2 * 2 * 4  # the element before the last is missing: no left end
    token = relax.apply_to(m)
    at_once = phase()
    relax.apply_to(at_once, grouping=Crossed(left_end=left_end))
    assert sorted(str(row.expr) for row in relax.shifted_rows_of(m)) == sorted(
        str(row.expr) for row in relax.shifted_rows_of(at_once)
    )
    relax.revert(m, token)
    assert sorted(str(row.expr) for row in relax.shifted_rows_of(m)) == apart


def test_elements_without_numbers_have_no_left_ends():
    m = stages()
    m.cc[0, 0].set_group("swing")
    with pytest.raises(ComplementarityError, match=r"'cc\[0,0\]': its group label is 'swing'.*Number the elements"):
        relaxation().apply_to(m, grouping=Crossed(left_end="first"))


def test_families_are_positions_and_keys_of_answers_and_what_the_user_says():
    m = phase()
    assert {pair.family for pair in m.phase.both.values()} == {(0,), (1,)}
    m = pyo.ConcreteModel()
    m.I = pyo.Set(initialize=[0, 1])
    m.a = pyo.Var(m.I, m.I, bounds=(0, None))
    m.b = pyo.Var(m.I, m.I, bounds=(0, None))
    options = {"rule": lambda m, i, k: complements(m.a[i, k], m.b[i, k])}
    m.by_default = Complementarity(m.I, m.I, **options)
    m.given = Complementarity(m.I, m.I, family=lambda m, i, k: i, **options)
    m.single = Complementarity(expr=complements(m.a[0, 0], m.b[0, 0]))
    assert [pair.family for pair in m.by_default.values()] == [(0,), (1,), (0,), (1,)]
    assert [pair.family for pair in m.given.values()] == [0, 0, 1, 1]
    assert m.single.family == ()
    with pytest.raises(ComplementarityError, match="the family label"):
        m.single.set_family([1])


def test_the_family_of_a_pair_over_a_continuous_set_is_the_rest_of_its_index():
    m = pyo.ConcreteModel()
    m.t = ContinuousSet(bounds=(0, 1))
    m.finger = pyo.Set(initialize=["left", "right"])
    m.a = pyo.Var(m.finger, m.t, bounds=(0, None), initialize=1)
    m.b = pyo.Var(m.finger, m.t, bounds=(0, None), initialize=1)
    m.x = pyo.Var(m.t, initialize=0)
    m.rate = DerivativeVar(m.x, wrt=m.t)
    m.motion = pyo.Constraint(m.t, rule=lambda m, t: m.rate[t] == m.a["left", t])
    m.cc = Complementarity(m.finger, m.t, rule=lambda m, i, t: complements(m.a[i, t], m.b[i, t]))
    m.cost = pyo.Objective(expr=m.x[1])
    pyo.TransformationFactory("pyrobocop.collocation").apply_to(m, wrt=m.t, nfe=2, ncp=2)
    for pair in active_pairs(m):
        assert pair.source.family == (pair.source.index()[0],)
    assert {len(group) for _, group in Crossed().groups([p for p in active_pairs(m) if p.group is not None])} == {2}


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
    relax.delta_of(m).set_value(0.04)
    assert [share.lb for share in block.shares.values()] == pytest.approx([SMALLEST_SHARE * 0.01] * 4)
    relax.revert(m, token)
    assert len(block.shares) == 2
    assert [share.lb for share in block.shares.values()] == pytest.approx([SMALLEST_SHARE * 0.02] * 2)
