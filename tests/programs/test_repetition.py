"""Which models the vectorised backend is taken for by default."""

from __future__ import annotations

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.programs.repetition import ENOUGH_NODES, REPETITIONS, repeats_nonlinear_terms


def waves(rows: int, terms: int) -> pyo.ConcreteModel:
    """Rows of one shape, each about 5 nodes for a term."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(rows), initialize=0.3)
    m.row = pyo.Constraint(range(rows), rule=lambda m, k: sum(pyo.sin(m.x[k] + i) for i in range(terms)) <= terms)
    m.cost = pyo.Objective(expr=sum((x - k / rows) ** 2 for k, x in m.x.items()))
    return m


def test_many_rows_of_one_large_shape_are_many_repetitions():
    assert repeats_nonlinear_terms(waves(100, ENOUGH_NODES // 300))


def test_few_repetitions_are_not():
    m = waves(REPETITIONS - 1, 200)
    assert not repeats_nonlinear_terms(m)
    m.more = pyo.Constraint(range(2), rule=lambda m, k: sum(pyo.sin(m.x[k] - i) for i in range(200)) <= 200)
    assert repeats_nonlinear_terms(m)


def test_small_models_count_as_large_ones_do():
    assert repeats_nonlinear_terms(waves(100, 5))


def test_terms_of_the_objective_count():
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(20), initialize=0.3)
    m.each = pyo.Expression(range(20), rule=lambda m, k: 0.1 * (m.x[k] - k) ** 2)
    m.cost = pyo.Objective(expr=2.0 * sum(m.each[k] for k in m.x) + 3.0 * m.x[0])
    assert repeats_nonlinear_terms(m)
    m.cost.deactivate()
    assert not repeats_nonlinear_terms(m)  # nothing else is there
    m.dense = pyo.Objective(expr=sum(k * x for k, x in m.x.items()) ** 4)
    assert not repeats_nonlinear_terms(m)


def test_rows_that_are_inactive_or_linear_do_not_count():
    m = waves(100, ENOUGH_NODES // 300)
    m.row.deactivate()
    m.cost.deactivate()
    m.y = pyo.Var(range(50))
    m.linear = pyo.Constraint(
        range(1000), rule=lambda m, k: sum(k * y / 3.0 - 2.0 * (y - 1) for y in m.y.values()) <= 1
    )
    assert not repeats_nonlinear_terms(m)


def test_different_rows_are_no_repetitions():
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=0.3)
    m.rows = pyo.ConstraintList()
    for count in range(2, 200):
        m.rows.add(sum(pyo.sin(m.x + i) for i in range(count)) <= count)
    assert not repeats_nonlinear_terms(m)


def test_named_expressions_count_wherever_they_are_used():
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=0.3)
    m.wave = pyo.Expression(expr=sum(pyo.sin(m.x + i) for i in range(200)))
    m.rows = pyo.Constraint(range(100), rule=lambda m, k: m.wave * m.x <= k)
    assert repeats_nonlinear_terms(m)


def test_external_functions_are_left_to_asl():
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=0.3)
    m.outside = pyo.ExternalFunction(library="nowhere.so", function="f")
    m.call = pyo.Constraint(expr=m.outside(m.x) <= 1.0)
    m.inner = waves(100, ENOUGH_NODES // 300)
    assert repeats_nonlinear_terms(m.inner)
    assert not repeats_nonlinear_terms(m)


@pytest.mark.ipopt
@pytest.mark.asl
@pytest.mark.casadi
@pytest.mark.parametrize(("rows", "expected"), [(100, "vectorised"), (3, "ASL")])
def test_solve_takes_what_fits_the_model_and_what_was_asked_for(rows, expected):
    m = waves(rows, 20)
    result = rcp.solve(m, polish=False)
    assert result.quality is rcp.Quality.OPTIMAL
    assert expected in result.derivatives
    assert "ASL" in rcp.solve(m, backend="asl").derivatives


def test_a_small_model_does_not_count_where_a_number_of_nodes_is_asked():
    m = waves(100, 5)
    assert repeats_nonlinear_terms(m, fewest_nodes=100)
    assert not repeats_nonlinear_terms(m, fewest_nodes=100_000)
