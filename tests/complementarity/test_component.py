"""The component: what it takes, what it refuses, and how it behaves as a part of a Pyomo model."""

from __future__ import annotations

import io

import pyomo.environ as pyo
import pyomo.mpec as mpec
import pytest

from pyrobocop_pyomo.complementarity import Complementarity, active_pairs, complements
from pyrobocop_pyomo.errors import ComplementarityError


@pytest.fixture
def model():
    m = pyo.ConcreteModel()
    m.I = pyo.Set(initialize=[1, 2, 3])
    m.x = pyo.Var(m.I, bounds=(0, None), initialize=1)
    m.y = pyo.Var(m.I, bounds=(0, None), initialize=2)
    m.p = pyo.Param(initialize=1, mutable=True)
    m.truth = pyo.BooleanVar()
    m.cost = pyo.Objective(expr=sum(m.x[i] for i in m.I))
    return m


def by_rule(m, i):
    return complements(m.x[i] >= 0, m.y[i] >= 0)


def test_a_scalar_component_is_its_own_pair(model):
    model.cc = Complementarity(expr=by_rule(model, 1))
    assert model.cc.args[0].args[1] is model.x[1]
    assert [pair.source for pair in active_pairs(model)] == [model.cc]
    assert len(model.cc) == 1


@pytest.mark.parametrize(
    "given",
    [by_rule, lambda m, i: (m.x[i] >= 0, m.y[i] >= 0)],
    ids=["complements", "tuple"],
)
def test_a_rule_gives_one_pair_per_index(model, given):
    model.cc = Complementarity(model.I, rule=given)
    assert [pair.name for pair in active_pairs(model)] == ["cc[1]", "cc[2]", "cc[3]"]


def test_a_mapping_gives_the_pairs_it_has(model):
    model.cc = Complementarity(model.I, rule={2: by_rule(model, 2)})
    assert list(model.cc) == [2]


def test_a_pair_can_be_skipped_and_assigned_later(model):
    model.cc = Complementarity(model.I, rule=lambda m, i: by_rule(m, i) if i != 2 else Complementarity.Skip)
    assert list(model.cc) == [1, 3]
    model.cc[2] = by_rule(model, 2)
    assert sorted(model.cc) == [1, 2, 3]
    model.cc[2] = Complementarity.Skip
    assert sorted(model.cc) == [1, 3]


def test_an_abstract_model_builds_its_pairs_when_it_is_created():
    m = pyo.AbstractModel()
    m.I = pyo.Set(initialize=[1, 2])
    m.x = pyo.Var(m.I, bounds=(0, None))
    m.y = pyo.Var(m.I, bounds=(0, None))
    m.cc = Complementarity(m.I, rule=by_rule)
    m.scalar = Complementarity(rule=lambda m: by_rule(m, 1))
    with pytest.raises(ComplementarityError, match="'scalar': has no sides yet"):
        _ = m.scalar.args
    with pytest.raises(ComplementarityError, match="'scalar': takes sides only once it is constructed"):
        m.scalar.set_value((None, None))
    assert len(active_pairs(m.create_instance())) == 3


def test_pairs_live_in_indexed_blocks(model):
    @model.Block(model.I)
    def part(b, i):
        b.cc = Complementarity(expr=by_rule(model, i))

    assert [pair.name for pair in active_pairs(model)] == ["part[1].cc", "part[2].cc", "part[3].cc"]


def test_groups_and_weights_are_kept_per_pair_and_by_default_no_label_and_one(model):
    model.cc = Complementarity(model.I, rule=by_rule, group=lambda m, i: i % 2, weight={1: 1, 2: model.p, 3: 0.5})
    model.one = Complementarity(expr=by_rule(model, 1))
    pairs = (*model.cc.values(), model.one)
    assert [(pair.group, pyo.value(pair.weight)) for pair in pairs] == [(1, 1), (0, 1), (1, 0.5), (None, 1)]


def test_pprint_and_display_show_the_sides(model):
    model.cc = Complementarity(model.I, rule=by_rule)
    for show in (model.cc.pprint, model.cc.display, model.pprint):
        stream = io.StringIO()
        show(ostream=stream)
        assert "0  <=  x[2]" in stream.getvalue()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"weight": -1}, r"the weight is -1; it must be finite and >= 0"),
        ({"weight": float("inf")}, r"the weight is inf"),
        ({"weight": "much"}, r"the weight 'much' is not a number"),
        ({"weight": lambda m, i: m.x[i]}, r"holds a variable"),
        ({"group": lambda m, i: [i]}, r"label \[1\] is not hashable"),
        ({"group": {2: "a"}}, r"mapping given as group= has no entry"),
        ({"weight": {2: 1}}, r"mapping given as weight= has no entry"),
    ],
)
def test_a_wrong_group_or_weight_is_refused(model, options, message):
    with pytest.raises(ComplementarityError, match=r"^'cc\[1\]': .*" + message):
        model.cc = Complementarity(model.I, rule=by_rule, **options)


def test_rule_and_expr_exclude_each_other():
    with pytest.raises(ValueError, match="only accepts one of"):
        Complementarity(rule=by_rule, expr=by_rule)


def test_importing_this_package_leaves_the_decorators_of_pyomo_alone(model):
    @model.Complementarity(model.I)
    def theirs(m, i):
        return mpec.complements(m.x[i] >= 0, m.y[i] >= 0)

    assert model.theirs.ctype is mpec.Complementarity


def test_several_index_sets_and_indexed_weights(model):
    model.step = pyo.Param(model.I, initialize={1: 0.1, 2: 0.2, 3: 0.3}, mutable=True)
    model.cc = Complementarity(
        model.I,
        model.I,
        rule=lambda m, i, j: complements(m.x[i] >= 0, m.y[j] >= 0),
        group=lambda m, i, j: j,
        weight=lambda m, i, j: m.step[i] * 2,
    )
    assert model.cc[1, 3].group == 3
    model.step[1] = 5
    assert pyo.value(model.cc[1, 3].weight) == 10


def test_a_parameter_is_a_weight_for_all_pairs_or_one_for_each(model):
    model.step = pyo.Param(model.I, initialize={1: 0.1, 2: 0.2, 3: 0.3}, mutable=True)
    model.each = Complementarity(model.I, rule=by_rule, weight=model.step)
    model.all = Complementarity(model.I, rule=by_rule, weight=model.p)
    assert all(model.each[i].weight is model.step[i] for i in model.I)
    assert all(model.all[i].weight is model.p for i in model.I)
