"""Relaxations as numbers: formulas, limits, nested sets, symmetry and equivalences, without a model or a solver."""

import math
from itertools import pairwise

import numpy as np
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
    Elastic,
    Fixed,
    FollowBarrier,
    Geometric,
    KanzowSchwartz,
    PerElement,
    PerPair,
    Relaxation,
    Scholtes,
    Superlinear,
    active_pairs,
    complements,
    relaxation_rows_of,
    rows_of,
    shifted_rows_of,
    sources_of,
)
from pyrobocop_pyomo.complementarity.relaxations import RELAXATIONS, as_grouping, as_relaxation
from pyrobocop_pyomo.errors import ComplementarityError

from .harness import RELAX, stages

BOUNDING = [made for make in RELAXATIONS.values() if isinstance(made := make(), Relaxation)]

signed = st.floats(-2, 10)
deltas = st.floats(1e-3, 1.0)


@pytest.mark.parametrize("relaxation", BOUNDING, ids=str)
@given(a=signed, b=signed, delta=deltas)
def test_floats_arrays_expressions_and_swapped_sides_give_the_same_numbers(relaxation, a, b, delta):
    """The formulas themselves are in the documentation: tests/docs/test_relaxation_formulas.py compares with them."""
    expected = relaxation.residual(a, b, delta)
    m = pyo.ConcreteModel()
    m.a, m.b = pyo.Var(initialize=a), pyo.Var(initialize=b)
    m.delta = pyo.Param(initialize=delta, mutable=True)
    arrays = relaxation.residual(np.array([a, a]), np.array([b, b]), delta)
    found = [pyo.value(relaxation.residual(m.a, m.b, m.delta)), *arrays]
    assert found == pytest.approx([expected] * 3, abs=1e-9)
    assert relaxation.residual(b, a, delta) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("relaxation", BOUNDING, ids=str)
@given(a=signed, b=signed, delta=deltas)
def test_a_shift_is_what_the_residual_falls_by(relaxation, a, b, delta):
    if (shift := relaxation.shift(delta)) is not None:
        assert relaxation.residual(a, b, 0.0) - shift == pytest.approx(relaxation.residual(a, b, delta), abs=1e-12)


class WrongShift(Scholtes):
    """Its bound would move by half of what its residual says."""

    def shift(self, delta):
        return delta / 2


def test_words_stand_for_objects():
    assert as_relaxation("kanzow_schwartz") == as_relaxation("kanzow-schwartz") == KanzowSchwartz()
    assert as_relaxation("elastic") == Elastic()
    for word in RELAXATIONS:
        assert as_relaxation(word) == as_relaxation(as_relaxation(word))
        hash(as_relaxation(word))


# --------------------------------------------------------------------
# Relaxations, groupings and schedules on their own: laws of numbers, no model and no solver.


positive = st.floats(1e-6, 1e6)
tolerances = st.floats(1e-10, 1.0)


@pytest.mark.parametrize(
    ("given", "convert", "message"),
    [
        ("schotles", as_relaxation, r"unknown relaxation 'schotles'\. Known: 'scholtes', "),
        (3, as_relaxation, r"3 is not a relaxation"),
        (Scholtes, as_relaxation, r"is not a relaxation.*Pass an object"),
        (WrongShift(), as_relaxation, r"shift\(0\.25\) is 0\.125, .* falls by 0\.25"),
        ("time", as_grouping, r"unknown grouping 'time'\. Known: 'pair', 'element'"),
        (PerPair, as_grouping, r"is not a grouping"),
    ],
)
def test_an_unknown_choice_is_refused_with_the_known_ones(given, convert, message):
    with pytest.raises(ValueError, match=message):
        convert(given)


@pytest.fixture
def pairs():
    m = pyo.ConcreteModel()
    m.x = pyo.Var([1, 2, 3], bounds=(0, None), initialize=1)
    pair = (m.x[1], m.x[2])
    m.one = Complementarity([1, 2, 3], rule=lambda m, i: complements(*pair))
    m.two = Complementarity([1, 2], rule=lambda m, i: complements(*pair))
    m.labelled = Complementarity([1, 2, 3], rule=lambda m, i: complements(*pair), group=lambda m, i: (i + 1) // 2)
    m.part = pyo.Block([1, 2])
    for i in (1, 2):
        m.part[i].u = Complementarity(expr=complements(*pair))
        m.part[i].v = Complementarity(expr=complements(*pair))
    yield active_pairs(m)  # noqa: PT022  (a pair does not keep its model alive)


def test_per_element_gathers_label_or_index_within_a_block(pairs):
    groups = [[pair.name for pair in members] for _, members in PerElement().groups(pairs)]
    assert groups == [
        ["one[1]", "two[1]"],
        ["one[2]", "two[2]"],
        ["one[3]"],
        ["labelled[1]", "labelled[2]"],
        ["labelled[3]"],
        ["part[1].u", "part[1].v"],
        ["part[2].u", "part[2].v"],
    ]


@pytest.mark.parametrize("grouping", [PerPair(), PerElement()])
def test_a_grouping_loses_no_pair_and_repeats_none(pairs, grouping):
    groups = grouping.groups(pairs)
    assert sorted(pair.name for _, members in groups for pair in members) == sorted(pair.name for pair in pairs)
    named = [name for name, _ in groups if name is not None]
    assert len(set(named)) == len(named)


@given(first=st.floats(1e-3, 10), factor=st.floats(0.05, 0.9), last=st.floats(1e-10, 1e-3))
def test_a_geometric_schedule_shrinks_from_first_to_last_by_the_factor(first, factor, last):
    steps = list(Geometric(first, factor, last).steps())
    assert steps[-1] == last
    assert steps[0] == (first if first > last * (1 + 1e-9) else last)
    for before, after in pairwise(steps):
        assert after <= before
        assert after >= before * factor * (1 - 1e-9)


def test_the_default_schedule_has_nine_steps_despite_rounding():
    steps = list(Geometric(1.0, 0.1, 1e-8).steps())
    assert len(steps) == 9
    assert steps == pytest.approx([10.0**-k for k in range(9)])


@given(mu=st.floats(0, 10), floor=tolerances, factor=positive)
def test_delta_follows_the_barrier_parameter_down_to_the_floor(mu, floor, factor):
    rule = FollowBarrier(floor, factor)
    assert rule.delta_for(mu) == (factor * mu if factor * mu > floor else floor)
    assert list(rule.steps()) == [floor]


@given(first=st.floats(1e-3, 10), factor=st.floats(0.05, 0.9), exponent=st.floats(1.1, 2), last=st.floats(1e-10, 1e-3))
def test_a_superlinear_schedule_takes_the_larger_of_both_reductions(first, factor, exponent, last):
    steps = list(Superlinear(first, factor, exponent, last).steps())
    assert steps[-1] == last
    for before, after in pairwise(steps):
        assert after <= before
        assert after == pytest.approx(max(last, min(factor * before, before**exponent)), rel=1e-8)
    assert len(steps) <= len(list(Geometric(first, factor, last).steps()))


@pytest.mark.parametrize(
    ("choice", "options", "message"),
    [
        (Fixed, {"delta": 0}, r"Fixed\(delta=0\): delta must be positive and finite"),
        (Geometric, {"first": -1}, "first must be positive"),
        (Geometric, {"factor": 1.0}, r"factor must lie between 0 and 1"),
        (Geometric, {"first": 1e-3, "last": 1e-2}, "last must be positive and at most first"),
        (Superlinear, {"exponent": 1.0}, "exponent must be above 1"),
        (Superlinear, {"factor": 0.0}, "factor must lie between 0 and 1"),
        (FollowBarrier, {"floor": 0.0}, "floor must be positive"),
        (FollowBarrier, {"factor": math.inf}, "factor must be positive and finite"),
        (Elastic, {"excess_bound": 0}, "must be positive"),
        (Crossed, {"left_end": "a"}, "left_end is None, 'first' or 'second'"),
    ],
)
def test_what_gives_no_schedule_relaxation_or_grouping_is_refused(choice, options, message):
    with pytest.raises(ComplementarityError, match=message):
        choice(**options)


# --------------------------------------------------------------------
# Which products are formed, and which share a bound.


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
    names = {tuple(source.index() for source in sources_of(row)) for row in shifted_rows_of(m)}
    assert names == {((i, j), (i, k)) if j != k else ((i, j),) for i in (0, 1) for j in (0, 1) for k in (0, 1)}
    assert len(rows_of(m.cc[0, 0])) == 3


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


@pytest.mark.parametrize("left_end", ["first", "second"])
def test_left_ends_do_not_depend_on_the_order_in_which_pairs_came(left_end):
    m = phase()
    RELAX.apply_to(m, grouping=Crossed(left_end=left_end), targets=list(m.phase.both.values())[::-1])
    in_order = phase()
    RELAX.apply_to(in_order, grouping=Crossed(left_end=left_end))
    assert sorted(str(row.expr) for row in shifted_rows_of(m)) == sorted(
        str(row.expr) for row in shifted_rows_of(in_order)
    )
    apart = phase()
    RELAX.apply_to(
        apart,
        grouping=Crossed(left_end=left_end),
        targets=[pair.source for pair in active_pairs(apart) if pair.group != 1],
    )
    assert len(shifted_rows_of(apart)) == 2 * 2 * 4  # the element before the last is missing: no left end


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
    assert [str(row.expr) for row in relaxation_rows_of(m)] == [str(row.expr) for row in relaxation_rows_of(alone)]
    assert shifted_rows_of(m) == []
