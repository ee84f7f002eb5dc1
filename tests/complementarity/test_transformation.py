"""The transformation: what it adds, that it can be undone, repeated, copied and questioned."""

import pyomo.environ as pyo
import pyomo.mpec as mpec
import pytest
from harness.checked import unchanged
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity import (
    Complementarity,
    active_pairs,
    complements,
    lifted_pairs_of,
    pairs_of,
    rows_of,
    shifted_rows_of,
    sources_of,
    without_penalty,
)
from pyrobocop_pyomo.complementarity.relaxations import GROUPINGS, RELAXATIONS
from pyrobocop_pyomo.errors import ComplementarityError

from .harness import RELAX, nl_text, round_trip, state, text_without_pairs


def build(sense=pyo.minimize):
    m = pyo.ConcreteModel()
    m.I = pyo.Set(initialize=[1, 2, 3])
    m.x = pyo.Var(m.I, bounds=(0, None), initialize=lambda m, i: i)
    m.free = pyo.Var(m.I, initialize=lambda m, i: 10 * i)
    m.p = pyo.Param(initialize=1, mutable=True)
    m.ours = Complementarity(m.I, rule=lambda m, i: complements(m.x[i] >= 0, m.free[i] + m.p >= 1), weight=2)
    m.theirs = mpec.Complementarity(m.I, rule=lambda m, i: mpec.complements(m.free[i] <= 9, m.x[i] * m.free[i] >= 0))
    m.part = pyo.Block([1, 2])
    for i in (1, 2):
        m.part[i].u = Complementarity(expr=complements(m.x[i], m.x[3]))
        m.part[i].v = Complementarity(expr=complements(m.x[i] <= 7, m.x[3]))
    m.row = pyo.Constraint(expr=m.x[1] + m.free[2] >= 1)
    m.cost = pyo.Objective(expr=sum(m.x[i] ** 2 + m.free[i] for i in m.I), sense=sense)
    return m


@pytest.fixture
def model():
    return build()


# ---- what is added


def test_a_side_becomes_a_row_only_where_no_bound_holds_it_and_a_row_of_the_user_has_no_source(model):
    RELAX.apply_to(model)
    assert lifted_pairs_of(model) == []
    x_side = rows_of(model.part[1].u)
    assert len(x_side) == 1
    product, side = rows_of(model.part[1].v)
    assert product in shifted_rows_of(model)
    assert side.ub == 7
    assert len(rows_of(model.theirs[2])) == 3
    assert sources_of(model.row) == []


@pytest.mark.parametrize(("sense", "sign"), [(pyo.minimize, 1), (pyo.maximize, -1)])
def test_the_penalty_makes_products_expensive_whatever_the_sense(sense, sign):
    m = build(sense)
    plain = pyo.value(m.cost)
    RELAX.apply_to(m, relaxation="penalty", delta=0.25)
    penalised = m.relaxed_complementarity.objective
    products = sum(pyo.value(pair.weight * pair.a * pair.b) for pair in pairs_of(m))
    assert penalised.sense == sense
    assert pyo.value(penalised) == pytest.approx(plain + sign * products / 0.25)
    assert not m.cost.active
    assert shifted_rows_of(m) == []
    RELAX.delta_of(m).set_value(0.5)
    assert pyo.value(penalised) == pytest.approx(plain + sign * products / 0.5)


def test_the_penalty_follows_the_objective_of_the_user_and_comes_from_all_pairs(model):
    token = RELAX.apply_to(model, relaxation="penalty")
    assert len(sources_of(token.block.objective)) == 10
    before = pyo.value(token.block.objective)
    model.cost.set_value(model.cost.expr + 5)
    assert pyo.value(token.block.objective) == before + 5


@pytest.mark.parametrize("relaxation", ["penalty", "elastic"])
def test_without_an_objective_the_penalty_is_all_that_is_minimised(model, relaxation):
    model.cost.deactivate()
    before, text = state(model), text_without_pairs(model)
    token = RELAX.apply_to(model, relaxation=relaxation, delta=0.25)
    penalty, expected = token.block.objective, token.block.component("excess")
    assert penalty.sense == pyo.minimize
    if relaxation == "penalty":
        expected = sum(pair.weight * pair.a * pair.b for pair in pairs_of(model))
    assert pyo.value(penalty) == pytest.approx(pyo.value(expected) / 0.25)
    copy = model.clone()
    assert nl_text(copy) == nl_text(model)
    with without_penalty(copy):
        assert not copy.relaxed_complementarity.objective.active
        assert not copy.cost.active
    assert copy.relaxed_complementarity.objective.active
    RELAX.revert(copy)
    RELAX.revert(model, token)
    assert state(model) == state(copy) == before
    assert text_without_pairs(model) == text


def test_a_penalty_is_not_put_below_the_objective_that_it_belongs_to(model):
    with pytest.raises(ComplementarityError, match=r"'part\[1\]'.*'cost' of 'unknown'.*targets= the blocks"):
        RELAX.apply_to(model.part[1], relaxation="penalty")


# ---- the way back


def test_a_token_works_once_and_for_its_own_model(model):
    with pytest.raises(ComplementarityError, match="'unknown': nothing to revert"):
        RELAX.revert(model)
    token = RELAX.apply_to(model)
    copy = model.clone()
    with pytest.raises(ComplementarityError, match="the token was made for another model"):
        RELAX.revert(copy, token)
    RELAX.revert(model, token)
    with pytest.raises(ComplementarityError, match="nothing to revert"):
        RELAX.revert(model, token)


# ---- parts only


def test_pairs_outside_the_targets_stay_active_and_the_writer_names_them(model):
    RELAX.apply_to(model, targets=[model.part, model.ours, model.theirs[1]])
    assert [pair.name for pair in active_pairs(model)] == ["theirs[2]", "theirs[3]"]
    assert model.theirs.active
    assert not model.ours.active
    with pytest.raises(ValueError, match=r"theirs\[2\]\s+theirs\[3\]\s*$"):
        nl_text(model)


def test_a_sub_block_is_relaxed_on_its_own(model):
    before = state(model)
    token = RELAX.apply_to(model.part[1])
    assert token.block.parent_block() is model.part[1]
    assert [row.parent_block() for row in shifted_rows_of(model)] == [token.block] * 2
    assert RELAX.delta_of(model) is token.block.delta
    assert len(pairs_of(model)) == 10
    assert len(pairs_of(model.part[1])) == 2
    RELAX.revert(model.part[1], token)
    assert state(model) == before


def test_two_deltas_over_one_model_are_refused(model):
    RELAX.apply_to(model.part[1])
    with pytest.raises(ComplementarityError, match=r"pairs of 'part\[1\]' are relaxed already"):
        RELAX.apply_to(model)
    RELAX.revert(model.part[1])
    RELAX.apply_to(model, targets=model.ours)
    with pytest.raises(ComplementarityError, match=r"'part\[1\]': pairs of 'unknown' are relaxed already.*targets="):
        RELAX.apply_to(model.part[1])
    assert len(pairs_of(model.part[1])) == 2


def test_of_several_relaxed_blocks_no_single_delta_is_given(model):
    with pytest.raises(ComplementarityError, match="expected one relaxation in it, found none"):
        RELAX.delta_of(model)
    RELAX.apply_to(model.part[1])
    RELAX.apply_to(model.part[2])
    assert len(shifted_rows_of(model)) == 4
    with pytest.raises(ComplementarityError, match=r"found 'part\[1\]\.relaxed_complementarity', 'part\[2\]"):
        RELAX.delta_of(model)


def test_a_deactivated_pair_is_untouched_and_can_follow_later(model):
    model.ours[2].deactivate()
    model.part[2].deactivate()
    first = RELAX.apply_to(model)
    assert not model.ours[2].active
    with pytest.raises(ComplementarityError, match=r"'ours\[2\]': is not relaxed"):
        rows_of(model.ours[2])
    model.ours[2].activate()
    model.part[2].activate()
    assert [pair.name for pair in active_pairs(model)] == ["ours[2]", "part[2].u", "part[2].v"]
    with pytest.raises(ComplementarityError, match="pairs of 'unknown' are relaxed already.*Revert there first"):
        RELAX.apply_to(model)
    RELAX.revert(model, first)
    RELAX.apply_to(model)
    assert len(shifted_rows_of(model)) == 10


def test_the_name_of_the_generated_block_is_unique(model):
    model.relaxed_complementarity = pyo.Block()
    model.relaxed_complementarity.delta = pyo.Param(initialize=3)
    before = state(model)
    token = RELAX.apply_to(model)
    assert token.block is not model.relaxed_complementarity
    RELAX.revert(model, token)
    assert state(model) == before


# ---- failures leave nothing behind


def no_pairs(m):
    for source in (m.ours, m.theirs, m.part):
        source.deactivate()


FAILURES = [
    (no_pairs, {}, r"'unknown': no active complementarity pair in it; there is nothing to relax"),
    (None, {"targets": []}, r"no active complementarity pair in the targets"),
    (
        lambda m: m.add_component("other", pyo.Objective(expr=m.x[1])),
        {"relaxation": "penalty"},
        r"2 active objectives \('cost', 'other'\)",
    ),
    (None, {"grouping": "none"}, r"unknown grouping 'none'"),
    (None, {"delta": -1}, r"delta"),
    (None, {"shrink": 0.1}, r"shrink"),
]


@pytest.mark.parametrize(("spoil", "options", "message"), FAILURES)
def test_a_failure_leaves_the_model_as_it_was(model, spoil, options, message):
    if spoil is not None:
        spoil(model)
    with unchanged(state, model), unchanged(text_without_pairs, model), pytest.raises(ValueError, match=message):
        RELAX.apply_to(model, **options)


# ---- residuals


def test_residuals_do_not_look_at_the_rows(model):
    token = RELAX.apply_to(model)
    expected = RELAX.residuals(model)
    token.block.rows.deactivate()
    token.block.rows[0].set_value(model.x[1] <= 100)
    assert RELAX.residuals(model) == expected


@given(a=st.floats(-5, 5), b=st.floats(-5, 5))
def test_residuals_measure_product_distance_and_violation(a, b):
    m = pyo.ConcreteModel()
    m.a, m.b = pyo.Var(initialize=a), pyo.Var(initialize=b)
    m.cc = Complementarity(expr=complements(m.a >= 0, m.b >= 0))
    (residual,) = RELAX.residuals(m)
    assert residual.name == "cc"
    assert residual.product == a * b
    assert residual.natural == min(a, b)
    assert (residual.natural == 0) == (min(a, b) == 0)


def test_a_variable_without_a_value_is_named(model):
    model.x[2].set_value(None)
    with pytest.raises(ComplementarityError, match=r"'ours\[2\]': the side 'x\[2\]' holds a variable without a value"):
        RELAX.residuals(model)


def test_a_family_of_blocks_or_an_abstract_model_is_refused(model):
    with pytest.raises(ComplementarityError, match="'part': is a family of blocks"):
        RELAX.apply_to(model.part)
    with pytest.raises(ComplementarityError, match="is not constructed"):
        RELAX.apply_to(pyo.AbstractModel())


# --------------------------------------------------------------------
# Every relaxation with every grouping, half of them lifted: there and back, and to a point that meets the pairs.


GROUPING_CHOICES = list(GROUPINGS)
CHOICES = list(RELAXATIONS)


# Each of both with some of the other: what they do together is tested by `test_there_and_back`, for all of them.
COVERING = [(choice, GROUPING_CHOICES[k % len(GROUPING_CHOICES)]) for k, choice in enumerate(CHOICES)]


def contact(m, element, stage):
    return complements(m.gap[element, stage] >= 0, 2 * m.force[element, stage] - m.gap[element, stage] + 1 >= 0)


def element_of(m, element, stage):
    return element


def friction(m, element):
    return complements(pyo.inequality(-1, m.force[element, 1], m.top), m.speed[element])


def two_elements():
    """Two elements of two stages with a plain and an affine side, and a range for each element."""
    m = pyo.ConcreteModel(name="two elements")
    m.I = pyo.Set(initialize=[1, 2])
    m.top = pyo.Param(initialize=2.0, mutable=True)
    m.gap = pyo.Var(m.I, m.I, bounds=(0, None), initialize=0.7)
    m.force = pyo.Var(m.I, m.I, initialize=0.4)
    m.speed = pyo.Var(m.I, initialize=0.3)
    m.contact = Complementarity(m.I, m.I, rule=contact, group=element_of, weight=0.5)
    m.friction = Complementarity(m.I, rule=friction)
    m.cost = pyo.Objective(
        expr=sum((m.gap[i, k] - i) ** 2 + (m.force[i, k] - 1) ** 2 for i in m.I for k in m.I)
        + sum((m.speed[i] - 1) ** 2 for i in m.I)
    )
    return m


def stop(b, i):
    m = b.model()
    return mpec.complements(m.speed[i] <= 9, m.gap[i, 2] * m.force[i, 2] >= 0)


@pytest.mark.parametrize("grouping", GROUPING_CHOICES, ids=str)
@pytest.mark.parametrize("choice", CHOICES)
def test_there_and_back(choice, grouping):
    m = two_elements()
    m.part = pyo.Block([1, 2])
    for i, part in m.part.items():
        part.stop = mpec.Complementarity(m.I, rule=stop)
        part.equal = Complementarity(expr=complements(m.speed[i] == m.gap[i, 1], m.force[i, 1]))
        part.signed = Complementarity(expr=complements(pyo.inequality(-1, m.force[i, 2], m.top), m.speed[i] <= 0))
        part.several = mpec.ComplementarityList(rule=[mpec.complements(m.force[i, 1] >= -4, m.speed[i] <= 4)])
    lift = (CHOICES.index(choice) + GROUPING_CHOICES.index(grouping)) % 2 == 0
    round_trip(m, relaxation=choice, grouping=grouping, lift=lift, delta=0.1)


@pytest.mark.asl
@pytest.mark.parametrize(("choice", "grouping"), COVERING)
def test_solved_and_back(choice, grouping):
    m = two_elements()
    before = state(m)
    result = rcp.solve(
        m,
        strategies=rcp.Strategy(
            schedule=rcp.relaxations.Geometric(), relaxation=choice, grouping=grouping, polish=False
        ),
        backend="asl",
    )
    # Where a relaxation leaves a pair to its signs alone, the product is as small as the barrier makes it.
    assert result.largest_product <= 1e-7
    assert result.constraint_violation <= 1e-6
    assert state(m) == before
