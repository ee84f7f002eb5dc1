"""The canonical form: the bound is found by structure, and rows are asked for only where no bound does the work."""

import io

import pyomo.environ as pyo
import pyomo.mpec as mpec
import pytest
from pyomo.gdp import Disjunct

from pyrobocop_pyomo.complementarity import Complementarity, active_pairs, canonical_form, complements
from pyrobocop_pyomo.errors import ComplementarityError


@pytest.fixture
def model():
    m = pyo.ConcreteModel()
    m.free = pyo.Var(initialize=3)
    m.x = pyo.Var(bounds=(0, None), initialize=1)
    m.y = pyo.Var(bounds=(None, 5), initialize=2)
    m.box = pyo.Var(bounds=(1, 4), initialize=2)
    m.p = pyo.Param(initialize=1, mutable=True)
    m.constant = pyo.Param(initialize=0)
    m.moving = pyo.Var(bounds=(m.p, None), initialize=2)
    m.e = pyo.Expression(expr=m.x + m.free)
    return m


def side(m, given, **bounds):
    """Value and need of a row of one side, in both positions; both have to agree."""
    if m.component("other") is None:
        m.other = pyo.Var()
    m.first = Complementarity(expr=complements(given, m.other >= 0, **{f"first_{k}": v for k, v in bounds.items()}))
    m.second = Complementarity(expr=complements(m.other >= 0, given, **{f"second_{k}": v for k, v in bounds.items()}))
    (one,), (two,) = canonical_form(m.first).pairs, canonical_form(m.second).pairs
    m.del_component("first")
    m.del_component("second")
    assert pyo.value(one.a) == pyo.value(two.b)
    assert (one.a_row is None) == (two.b_row is None)
    return one.a, one.a_row


FORMS = {
    "free >= 1": (lambda m: m.free >= 1, 2, True),
    "1 <= free": (lambda m: 1 <= m.free, 2, True),  # noqa: SIM300
    "free <= 4": (lambda m: m.free <= 4, 1, True),
    "expr >= p": (lambda m: m.x + m.free >= m.p, 3, True),
    "expr <= 2 p": (lambda m: m.x - m.free <= 2 * m.p, 4, True),
    "lhs >= rhs": (lambda m: m.free >= m.x, 2, True),
    "named >= 1": (lambda m: m.e >= 1, 3, True),
    "own bound": (lambda m: m.x >= 0, 1, False),
    "tighter own bound": (lambda m: m.box >= 0, 2, False),
    "looser own bound": (lambda m: m.box >= 1.5, 0.5, True),
    "own upper bound": (lambda m: m.y <= 5, 3, False),
    "the bound's own parameter": (lambda m: m.moving >= m.p, 1, False),
    "a parameter that may pass the bound": (lambda m: m.box >= m.p, 1, True),
    "a number that the bound may pass": (lambda m: m.moving >= 0, 2, True),
    "plain variable, lower": (lambda m: m.x, 1, False),
    "plain variable, upper": (lambda m: m.y, 3, False),
    "plain variable, parameter": (lambda m: m.moving, 1, False),
}


@pytest.mark.parametrize("fixed", [False, True])
@pytest.mark.parametrize("form", FORMS)
def test_every_form_becomes_a_nonnegative_expression_whatever_is_fixed(model, form, fixed):
    given, value, needs_row = FORMS[form]
    for variable in (model.free, model.x, model.y, model.box, model.moving) if fixed else ():
        variable.fix()
    expression, row = side(model, given(model))
    assert pyo.value(expression) == value
    assert (row is not None) == needs_row


def test_a_zero_bound_leaves_the_bare_variable(model):
    for form in (model.x >= 0, model.x, model.x >= model.constant):
        assert side(model, form)[0] is model.x
    model.w = pyo.Var(domain=pyo.NonNegativeReals, bounds=(0, None), initialize=1)
    assert side(model, model.w)[0] is model.w


def test_of_two_own_bounds_one_is_chosen(model):
    assert pyo.value(side(model, model.box, bound="lower")[0]) == 1
    assert pyo.value(side(model, model.box, bound="upper")[0]) == 2


def test_all_active_pairs_are_found_in_the_order_of_declaration(model):
    pair = (model.x >= 0, model.free >= 0)
    model.one = Complementarity([2, 1], rule=lambda m, i: pair)
    model.two = mpec.Complementarity([1, 2], rule=lambda m, i: pair)
    model.blocks = pyo.Block([1, 2])
    model.blocks[1].inner = mpec.Complementarity(expr=pair)
    model.blocks[2].inner = Complementarity(expr=pair)
    model.list = mpec.ComplementarityList(rule=[mpec.complements(*pair), mpec.complements(*pair)])
    model.disjunct = Disjunct([1, 2])
    model.disjunct[1].inner = Complementarity(expr=pair)
    model.disjunct[2].inner = Complementarity(expr=pair)

    model.one[1].deactivate()
    model.blocks[1].deactivate()
    model.disjunct[2].deactivate()

    names = [pair.name for pair in active_pairs(model)]
    assert sorted(names) == sorted(
        ["one[2]", "two[1]", "two[2]", "list[1]", "list[2]", "blocks[2].inner", "disjunct[1].inner"]
    )
    assert names == [pair.name for pair in active_pairs(model.clone())]
    assert [name for name in names if "." not in name] == ["one[2]", "two[1]", "two[2]", "list[1]", "list[2]"]


def test_targets_choose_blocks_components_and_single_pairs(model):
    pair = (model.x >= 0, model.free >= 0)
    model.cc = Complementarity([1, 2, 3], rule=lambda m, i: pair)
    model.blocks = pyo.Block([1, 2], rule=lambda b, i: setattr(b, "cc", Complementarity(expr=pair)))

    def names(targets):
        return [pair.name for pair in active_pairs(model, targets)]

    assert names(model.cc) == ["cc[1]", "cc[2]", "cc[3]"]
    assert names([model.cc[3], model.cc[1]]) == ["cc[3]", "cc[1]"]
    assert names([model.cc[3], model.cc]) == ["cc[3]", "cc[1]", "cc[2]"]
    assert names(model.blocks) == ["blocks[1].cc", "blocks[2].cc"]
    assert names(model.blocks[2]) == ["blocks[2].cc"]
    model.blocks[2].deactivate()
    assert names([model.blocks[2].cc, model.cc[2]]) == ["cc[2]"]
    model.cc[2].deactivate()
    assert names([model.cc[2]]) == []


# --------------------------------------------------------------------
# The component: what it takes, what it refuses, and how it behaves as a part of a Pyomo model.


@pytest.fixture
def indexed():
    m = pyo.ConcreteModel()
    m.I = pyo.Set(initialize=[1, 2, 3])
    m.x = pyo.Var(m.I, bounds=(0, None), initialize=1)
    m.y = pyo.Var(m.I, bounds=(0, None), initialize=2)
    m.p = pyo.Param(initialize=1, mutable=True)
    m.step = pyo.Param(m.I, initialize={1: 0.1, 2: 0.2, 3: 0.3}, mutable=True)
    m.cost = pyo.Objective(expr=sum(m.x[i] for i in m.I))
    return m


def by_rule(m, i):
    return complements(m.x[i] >= 0, m.y[i] >= 0)


def test_a_mapping_gives_the_pairs_it_has(indexed):
    indexed.cc = Complementarity(indexed.I, rule={2: by_rule(indexed, 2)})
    assert list(indexed.cc) == [2]


def test_a_pair_can_be_skipped_and_assigned_later(indexed):
    indexed.cc = Complementarity(indexed.I, rule=lambda m, i: by_rule(m, i) if i != 2 else Complementarity.Skip)
    assert list(indexed.cc) == [1, 3]
    indexed.cc[2] = by_rule(indexed, 2)
    assert sorted(indexed.cc) == [1, 2, 3]
    indexed.cc[2] = Complementarity.Skip
    assert sorted(indexed.cc) == [1, 3]


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


def test_groups_and_weights_are_kept_per_pair_and_by_default_no_label_and_one(indexed):
    indexed.cc = Complementarity(indexed.I, rule=by_rule, group=lambda m, i: i % 2, weight={1: 1, 2: indexed.p, 3: 0.5})
    indexed.one = Complementarity(expr=by_rule(indexed, 1))
    pairs = (*indexed.cc.values(), indexed.one)
    assert [(pair.group, pyo.value(pair.weight)) for pair in pairs] == [(1, 1), (0, 1), (1, 0.5), (None, 1)]


def test_pprint_and_display_show_the_sides(indexed):
    indexed.cc = Complementarity(indexed.I, rule=by_rule)
    for show in (indexed.cc.pprint, indexed.cc.display, indexed.pprint):
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
def test_a_wrong_group_or_weight_is_refused(indexed, options, message):
    with pytest.raises(ComplementarityError, match=r"^'cc\[1\]': .*" + message):
        indexed.cc = Complementarity(indexed.I, rule=by_rule, **options)


def test_importing_this_package_leaves_the_decorators_of_pyomo_alone(indexed):
    @indexed.Complementarity(indexed.I)
    def theirs(m, i):
        return mpec.complements(m.x[i] >= 0, m.y[i] >= 0)

    assert indexed.theirs.ctype is mpec.Complementarity


def test_a_parameter_is_a_weight_for_all_pairs_or_one_for_each(indexed):
    indexed.each = Complementarity(indexed.I, rule=by_rule, weight=indexed.step)
    indexed.all = Complementarity(indexed.I, rule=by_rule, weight=indexed.p)
    assert all(indexed.each[i].weight is indexed.step[i] for i in indexed.I)
    assert all(indexed.all[i].weight is indexed.p for i in indexed.I)
