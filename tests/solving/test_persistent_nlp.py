"""A model that is kept prepared solves as one that is built from scratch, only sooner."""

from __future__ import annotations

import pyomo.environ as pyo
import pytest
from harness.expression_zoo import cart_pole, parameters_everywhere

from pyrobocop_pyomo.solving import PersistentNLP

pytestmark = pytest.mark.casadi


def at_start(model: pyo.ConcreteModel, q: float, omega: float) -> pyo.ConcreteModel:
    model.swing.q[0].fix(q)
    model.swing.omega[0].fix(omega)
    return model


def test_a_changed_initial_state_solves_as_a_model_built_anew():
    kept = PersistentNLP(cart_pole(10))
    assert kept.solve().status.solved
    for q, omega in ((0.1, 0.0), (0.2, -0.1), (0.0, 0.05)):
        at_start(kept.model, q, omega)
        kept.model.length = 0.5 + q / 10
        warm = kept.solve()
        fresh_model = at_start(cart_pole(10), q, omega)
        fresh_model.length = 0.5 + q / 10
        for old, new in zip(
            kept.model.component_data_objects(pyo.Var), fresh_model.component_data_objects(pyo.Var), strict=True
        ):
            if not new.fixed:
                new.set_value(old.value)  # both in the same valley
        fresh = PersistentNLP(fresh_model).solve()
        assert warm.status.solved
        assert fresh.status.solved
        assert warm.objective == pytest.approx(fresh.objective, rel=1e-7)
        assert warm.g_multipliers == pytest.approx(fresh.g_multipliers, rel=1e-4, abs=1e-4)
        assert pyo.value(kept.model.cost) == pytest.approx(warm.objective)
    assert kept.preparations == 1


def test_a_warm_start_takes_fewer_iterations_than_a_cold_one():
    kept = PersistentNLP(cart_pole(10))
    first = kept.solve()
    at_start(kept.model, 0.02, 0.0)
    assert kept.solve().iterations < first.iterations
    values = [v.value for v in kept.model.component_data_objects(pyo.Var)]
    assert None not in values


def test_a_change_of_structure_prepares_the_model_again():
    kept = PersistentNLP(parameters_everywhere())
    kept.solve()
    kept.model.p[1] = 2.5
    kept.solve()
    assert kept.preparations == 1
    kept.model.x[3].fix(0.25)
    assert kept.solve().status.solved
    assert kept.preparations == 2
    assert kept.model.x[3].value == 0.25
    kept.model.extra = pyo.Constraint([1, 2], rule=lambda m, i: m.x[i] <= 1)
    kept.model.extra[1].deactivate()
    kept.solve()
    assert kept.preparations == 3
    kept.model.extra[1].activate()  # this is what nobody notices
    kept.prepare()
    assert kept.preparations == 4
    assert kept.solve().g.size == kept.outcome.g_multipliers.size


def test_options_time_limits_and_callbacks_reach_ipopt():
    kept = PersistentNLP(cart_pole(10), {"max_iter": 2})
    assert kept.solve().iterations == 2
    records = []
    assert kept.solve({"max_iter": 1}, on_iteration=records.append).iterations == 1
    assert len(records) == 2
    assert kept.solve({"max_iter": 300}, warm=False, time_limit=60.0).status.solved


def test_declared_suffixes_are_filled():
    model = parameters_everywhere()
    model.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    PersistentNLP(model).solve()
    assert model.linear in model.dual
