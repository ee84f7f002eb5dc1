"""Which products are formed, and which share a bound."""

import pyomo.environ as pyo
import pytest
from harness.phases import one_phase
from hypothesis import given
from hypothesis import strategies as st
from pyomo.dae import ContinuousSet, DerivativeVar

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity import (
    Complementarity,
    Crossed,
    KanzowSchwartz,
    active_pairs,
    complements,
)
from pyrobocop_pyomo.errors import ComplementarityError

from .harness import RELAX, stages

amounts = st.lists(st.floats(0.0, 10.0), min_size=8, max_size=8)


@given(values=amounts)
def test_crossed_products_are_penalised_with_the_mean_weight(values):
    m = stages(values)
    token = RELAX.apply_to(m, grouping="crossed", relaxation="penalty", delta=0.25)
    products = sum(values[2 * i + j] * values[4 + 2 * i + k] for i in (0, 1) for j in (0, 1) for k in (0, 1))
    assert pyo.value(token.block.objective) == pytest.approx(values[0] + 0.5 * products / 0.25, abs=1e-9)


def test_a_crossed_row_comes_from_the_pairs_of_both_sides():
    m = stages()
    RELAX.apply_to(m, grouping="crossed")
    names = {tuple(source.index() for source in RELAX.sources_of(row)) for row in RELAX.shifted_rows_of(m)}
    assert names == {((i, j), (i, k)) if j != k else ((i, j),) for i in (0, 1) for j in (0, 1) for k in (0, 1)}
    assert len(RELAX.rows_of(m.cc[0, 0])) == 3


def test_an_unknown_way_to_begin_is_refused():
    with pytest.raises(ComplementarityError, match="left_end is None, 'first' or 'second'"):
        Crossed(left_end="a")


def phase(elements=3, stages=2, statements=2):
    """A rule that returns a list: one component, several statements at each time."""
    m, b = one_phase("phase", model="listed", duration=1.0, elements=elements, stages=stages)
    for i in range(statements):
        b.declare(f"a{i}", rcp.Algebraic(bounds=(0, None), initial_guess=lambda t, i=i: 1 + i + t))
        b.declare(f"b{i}", rcp.Algebraic(bounds=(0, None), initial_guess=lambda t, i=i: 2 - i / 3 - t))

    @b.complementarity
    def both(b, t):
        return [complements(getattr(b, f"a{i}")[t], getattr(b, f"b{i}")[t]) for i in range(statements)]

    m.cost = pyo.Objective(expr=b.a0[b.points.first()])
    return m


crossings = st.builds(Crossed, left_end=st.sampled_from([None, "first", "second"]))


@given(grouping=crossings, elements=st.integers(1, 3), stages=st.integers(1, 3), statements=st.integers(1, 3))
def test_crossed_products_are_of_one_statement_and_hold_each_pair(grouping, elements, stages, statements):
    m = phase(elements, stages, statements)
    pairs = active_pairs(m)
    last = {pair.group: pair.source.index()[0] for pair in pairs}
    products = [product for _, group in grouping.groups(pairs) for product in grouping.products(group)]
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


def test_with_one_stage_and_no_left_end_crossed_is_pair_by_pair():
    written = []
    for grouping in ("crossed", "pair"):
        m = phase(elements=4, stages=1)
        RELAX.apply_to(m, grouping=grouping)
        written.append(sorted(str(row.expr) for row in RELAX.shifted_rows_of(m)))
    assert written[0] == written[1]


@pytest.mark.parametrize("left_end", ["first", "second"])
def test_left_ends_do_not_depend_on_the_order_in_which_pairs_came(left_end):
    m = phase()
    RELAX.apply_to(m, grouping=Crossed(left_end=left_end), targets=list(m.phase.both.values())[::-1])
    in_order = phase()
    RELAX.apply_to(in_order, grouping=Crossed(left_end=left_end))
    assert sorted(str(row.expr) for row in RELAX.shifted_rows_of(m)) == sorted(
        str(row.expr) for row in RELAX.shifted_rows_of(in_order)
    )
    apart = phase()
    RELAX.apply_to(
        apart,
        grouping=Crossed(left_end=left_end),
        targets=[pair.source for pair in active_pairs(apart) if pair.group != 1],
    )
    assert len(RELAX.shifted_rows_of(apart)) == 2 * 2 * 4  # the element before the last is missing: no left end


def test_elements_without_numbers_have_no_left_ends():
    m = stages()
    m.cc[0, 0].set_group("swing")
    with pytest.raises(ComplementarityError, match=r"'cc\[0,0\]': its group label is 'swing'.*Number the elements"):
        RELAX.apply_to(m, grouping=Crossed(left_end="first"))


def test_families_are_positions_and_keys_of_answers_and_what_the_user_says():
    m = phase()
    assert {pair.family for pair in m.phase.both.values()} == {(0,), (1,)}
    m = stages()
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


def test_products_without_a_shift_are_bounded_by_themselves():
    m = stages()
    RELAX.apply_to(m, grouping="element", relaxation=KanzowSchwartz(), delta=0.4)
    alone = stages()
    RELAX.apply_to(alone, relaxation=KanzowSchwartz(), delta=0.4)
    assert [str(row.expr) for row in RELAX.relaxation_rows_of(m)] == [
        str(row.expr) for row in RELAX.relaxation_rows_of(alone)
    ]
