"""The component: what it takes, what it refuses, and how it behaves as a part of a Pyomo model."""

from __future__ import annotations

import io
import pickle

import pyomo.environ as pyo
import pyomo.mpec as mpec
import pytest

from pyrobocop_pyomo.complementarity import Complementarity, active_pairs, complements
from pyrobocop_pyomo.errors import ComplementarityError

from .harness import nl_text


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


def test_groups_and_weights_are_kept_per_pair(model):
    model.cc = Complementarity(model.I, rule=by_rule, group=lambda m, i: i % 2, weight={1: 1, 2: model.p, 3: 0.5})
    assert [model.cc[i].group for i in model.I] == [1, 0, 1]
    assert [pyo.value(model.cc[i].weight) for i in model.I] == [1, 1, 0.5]


def test_group_and_weight_may_be_one_value_for_all(model):
    model.cc = Complementarity(model.I, rule=by_rule, group="step", weight=3)
    assert {(pair.group, pair.weight) for pair in active_pairs(model)} == {("step", 3)}


def test_without_group_and_weight_a_pair_has_no_label_and_measure_one(model):
    model.cc = Complementarity(expr=by_rule(model, 1))
    assert model.cc.group is None
    assert model.cc.weight == 1


def test_clones_and_pickles_refer_to_their_own_variables(model):
    model.cc = Complementarity(model.I, rule=by_rule, group=lambda_free_group, weight=2)
    for copy in (model.clone(), pickle.loads(pickle.dumps(model))):
        assert copy.cc[2].args[0].args[1] is copy.x[2]
        assert copy.cc[2].group == 0
        assert copy.cc[2].weight == 2
        assert copy.cc[2].parent_component() is copy.cc


def lambda_free_group(m, i):
    return i % 2


def test_pprint_and_display_show_the_sides(model):
    model.cc = Complementarity(model.I, rule=by_rule)
    for show in (model.cc.pprint, model.cc.display, model.pprint):
        stream = io.StringIO()
        show(ostream=stream)
        assert "0  <=  x[2]" in stream.getvalue()


def test_the_writer_refuses_a_model_with_an_active_pair(model):
    model.cc = Complementarity(model.I, rule=by_rule)
    with pytest.raises(ValueError, match="does not know how to process"):
        nl_text(model)
    model.cc.deactivate()
    nl_text(model)
    model.cc[2].activate()
    with pytest.raises(ValueError, match=r"cc\[2\]"):
        nl_text(model)


REFUSED = {
    "strict": (lambda m: m.x[2] > 0, r"strict inequality; a solver cannot hold one\. Write >= or <="),
    "equality": (lambda m: m.x[2] == 0, r"is an equality.*three finite bounds.*Make it a Constraint"),
    "variable range": (lambda m: pyo.inequality(m.x[1], m.x[2], 1), r"the bound 'x\[1\]' of side .* holds a variable"),
    "strict range": (lambda m: pyo.inequality(0, m.x[2], 1, strict=True), r"strict inequality"),
    "constant": (lambda m: 3.0, r"the constant 3\.0"),
    "bool": (lambda m: bool(pyo.value(m.p)) >= 0, r"the constant True"),
    "none": (lambda m: None, r"a side is None"),
    "parameter": (lambda m: m.p >= 0, r"holds no variable"),
    "bare": (lambda m: m.x[2] + 1, r"bare expression without a bound\. Write expr >= 0"),
    "indexed": (lambda m: m.x, r"stands for many variables"),
    "slice": (lambda m: m.x[:], r"stands for many variables"),
    "text": (lambda m: "x >= 0", r"constant 'x >= 0'"),
    "boolean": (lambda m: m.truth, r"expected a relation"),
    "object": (lambda m: object(), r"of type object; expected a relation"),
}


@pytest.mark.parametrize("case", REFUSED)
@pytest.mark.parametrize("position", [0, 1])
def test_what_can_be_no_side_is_refused_at_once_and_by_name(model, case, position):
    wrong, message = REFUSED[case]

    def rule(m, i):
        if i != 2:
            return by_rule(m, i)
        sides = [m.y[2] >= 0, m.y[2] >= 0]
        sides[position] = wrong(m)
        return complements(*sides)

    with pytest.raises(ComplementarityError, match=r"^'cc\[2\]': .*" + message):
        model.cc = Complementarity(model.I, rule=rule)


@pytest.mark.parametrize(
    ("returned", "message"),
    [
        (None, r"the rule returned None\. Return complements"),
        ((1, 2, 3), r"found tuple of length 3"),
        (7, r"found int"),
    ],
)
def test_a_rule_that_returns_no_pair_is_refused(model, returned, message):
    with pytest.raises(ComplementarityError, match=r"^'cc\[1\]': .*" + message):
        model.cc = Complementarity(model.I, rule=lambda m, i: returned)


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


def test_one_pair_cannot_serve_all_indices(model):
    with pytest.raises(ComplementarityError, match="'cc': one pair cannot serve all indices"):
        model.cc = Complementarity(model.I, rule=by_rule(model, 1))


def test_rule_and_expr_exclude_each_other():
    with pytest.raises(ValueError, match="only accepts one of"):
        Complementarity(rule=by_rule, expr=by_rule)


def test_a_bound_is_chosen_for_plain_variables_only(model):
    with pytest.raises(ComplementarityError, match=r"'cc': a bound 'lower' was chosen for the side"):
        model.cc = Complementarity(expr=complements(model.x[1] >= 0, model.y[1], first_bound="lower"))
    with pytest.raises(ComplementarityError, match=r"'other': unknown bound 'left'"):
        model.other = Complementarity(expr=complements(model.x[1], model.y[1], second_bound="left"))


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
