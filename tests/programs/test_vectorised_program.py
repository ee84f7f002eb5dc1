"""Vectorised expressions against ASL, against finite differences, and after changes of numbers."""

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.expression_zoo import ZOO, ZOO_NAMES, cart_pole, parameters_everywhere, trees
from harness.program_values import InModelOrder, assert_same
from harness.timed_models import example
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyomo.common.errors import InfeasibleConstraintException

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.programs.compiled_model import CompiledModel, KeptProgram

pytestmark = pytest.mark.casadi


def planar_pushing() -> pyo.ConcreteModel:
    model = example("planar_pushing").build(elements=10)
    pyo.TransformationFactory("pyrobocop.relax_complementarity").apply_to(model, delta=1e-2)
    return model


@pytest.mark.asl
@pytest.mark.parametrize("build", [*ZOO, planar_pushing], ids=[*ZOO_NAMES, "planar-pushing"])
def test_every_number_is_that_of_asl(build):
    ours, theirs = InModelOrder(CompiledModel(build(), "vectorised")), InModelOrder(CompiledModel(build(), "asl"))
    assert ours.names == theirs.names
    random = np.random.default_rng(7)
    for _ in range(3):
        x = random.uniform(0.02, 0.45, ours.nlp.n)
        factor, multipliers = random.uniform(-2, 2), random.uniform(-2, 2, ours.nlp.m)
        assert_same(ours.everything(x, factor, multipliers), theirs.everything(x, factor, multipliers))


@pytest.mark.parametrize("build", [*ZOO, planar_pushing], ids=[*ZOO_NAMES, "planar-pushing"])
def test_structures_hold_each_place_once_and_no_variable_is_unused(build):
    nlp = CompiledModel(build(), "vectorised").nlp
    for rows, columns in (nlp.jacobian_structure, nlp.hessian_structure):
        assert len(set(zip(rows.tolist(), columns.tolist(), strict=True))) == rows.size
    assert (nlp.hessian_structure[0] >= nlp.hessian_structure[1]).all()


MODEL = pyo.ConcreteModel("random")
MODEL.x = pyo.Var(range(4), initialize=0.5)
MODEL.p = pyo.Param(initialize=-0.4, mutable=True)
LEAVES = st.one_of(st.sampled_from([*MODEL.x.values(), *MODEL.x.values(), MODEL.p]), st.floats(-2, 2))


@pytest.mark.asl
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(rows=st.lists(trees(LEAVES), min_size=1, max_size=3), seed=st.integers(0, 1000))
def test_random_rows_have_the_derivatives_of_asl(rows, seed):
    MODEL.del_component("rows")
    MODEL.del_component("cost")
    MODEL.rows = pyo.ConstraintList()
    for row in rows:
        MODEL.rows.add((-100, row + MODEL.x[0], 100))
    MODEL.cost = pyo.Objective(expr=sum(v**2 for v in MODEL.x.values()) + rows[0])
    ours, theirs = InModelOrder(CompiledModel(MODEL, "vectorised")), InModelOrder(CompiledModel(MODEL, "asl"))
    random = np.random.default_rng(seed)
    x, multipliers = random.uniform(-1, 1, ours.nlp.n), random.uniform(-2, 2, ours.nlp.m)
    assert_same(ours.everything(x, 0.7, multipliers), theirs.everything(x, 0.7, multipliers))


@pytest.mark.parametrize("build", [parameters_everywhere, lambda: cart_pole(4)], ids=["parameters", "cart-pole"])
def test_refreshed_numbers_are_those_of_a_program_made_anew(build):
    model = build()
    kept = InModelOrder(CompiledModel(model, "vectorised"))
    random = np.random.default_rng(3)
    for component in model.component_data_objects(pyo.Var):
        if component.fixed:
            component.fix(random.uniform(-0.5, 0.5))
        else:
            component.set_value(random.uniform(-0.5, 0.5), skip_validation=True)
    for parameter in model.component_data_objects(pyo.Param):
        parameter.set_value(parameter.value + 0.1)
    free = [v for v in model.component_data_objects(pyo.Var) if not v.fixed]
    free[0].setlb(-77)
    free[1].setub(free[1].ub if free[1].ub is not None else 55)
    free[2].setub(model.component("p")[1] if model.component("p") is not None else 44)
    kept.nlp.refresh()
    anew = InModelOrder(CompiledModel(model, "vectorised"))
    x, multipliers = random.uniform(0, 0.5, anew.nlp.n), random.uniform(-1, 1, anew.nlp.m)
    assert_same(kept.everything(x, 0.3, multipliers), anew.everything(x, 0.3, multipliers))


def test_rows_without_variables_are_checked_at_each_refresh():
    model = parameters_everywhere()
    nlp = CompiledModel(model, "vectorised").nlp
    model.p[0] = 9.0
    with pytest.raises(InfeasibleConstraintException, match="'only_numbers'"):
        nlp.refresh()
    with pytest.raises(InfeasibleConstraintException, match="'only_numbers'"):
        CompiledModel(model, "vectorised")


def replace_a_row(model):
    """As many rows as before, and none of those that are left has changed."""
    expression = model.terms[1].expr
    del model.terms[1]
    model.terms[1] = expression


CHANGES = {
    "fix": lambda m: m.x[0].fix(0.1),
    "unfix": lambda m: m.x[5].unfix(),
    "deactivate one": lambda m: m.terms[2].deactivate(),
    "activate": lambda m: m.sleeping[1].activate(),
    "deactivate all": lambda m: m.terms.deactivate(),
    "add": lambda m: m.add_component("extra", pyo.Constraint(expr=m.x[0] <= 7)),
    "delete": lambda m: m.terms.__delitem__(1),
    "replace": replace_a_row,
    "set": lambda m: m.range.set_value(m.x[0] <= 3),
    "objective": lambda m: m.cost.set_value(m.x[0] ** 2),
    "sense": lambda m: m.cost.set_sense(pyo.maximize),
    "domain": lambda m: setattr(m.x[0], "domain", pyo.NonNegativeReals),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())
def test_changes_of_structure_are_noticed(change):
    model = parameters_everywhere()
    compiled = CompiledModel(model, "vectorised")
    before = compiled.nlp
    change(model)
    with pytest.raises(ModelError, match="'parameters': .* since it was prepared"):
        compiled.nlp.refresh()
    compiled.update()
    assert compiled.nlp is not before
    anew = InModelOrder(CompiledModel(model, "vectorised"))
    assert [v.name for v in compiled.variables] == [v.name for v in anew.compiled.variables]
    assert compiled.row_of[compiled.constraints[-1]] == len(compiled.constraints) - 1


@pytest.mark.parametrize("derivatives", ["vectorised", pytest.param("asl", marks=pytest.mark.asl)])
@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())
def test_a_kept_program_is_that_of_the_model_as_it_is_now(change, derivatives):
    model, kept = parameters_everywhere(), KeptProgram()
    first = kept.of(model, derivatives)
    rows = list(first.constraints)
    model.p[1] = 2.5
    second = kept.of(model, derivatives)
    assert (second is first) == (derivatives == "vectorised")
    change(model)
    third = kept.of(model, derivatives)
    assert third is not second
    # Whoever still holds an earlier one reads what its rows were.
    assert all(a is b for a, b in zip(first.constraints, rows, strict=True))
    anew = CompiledModel(model, derivatives)
    x = anew.current_point()
    assert third.nlp.objective(x) == anew.nlp.objective(x)
    assert np.array_equal(third.nlp.constraints(x), anew.nlp.constraints(x))
    assert np.array_equal(third.nlp.g_upper, anew.nlp.g_upper)


def test_a_kept_program_is_not_that_of_another_model():
    kept = KeptProgram()
    first, second = parameters_everywhere(), parameters_everywhere()
    assert kept.of(first, "vectorised").model is first
    assert kept.of(second, "vectorised").model is second


def test_a_changed_named_expression_is_noticed():
    model = pyo.ConcreteModel("named")
    model.x = pyo.Var(initialize=0.5)
    model.e = pyo.Expression(expr=model.x**2)
    model.row = pyo.Constraint(expr=pyo.sin(model.e) <= 1)
    nlp = CompiledModel(model, "vectorised").nlp
    model.e.set_value(model.x**3)
    with pytest.raises(ModelError, match="named expressions"):
        nlp.refresh()
