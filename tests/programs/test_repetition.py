"""Which models the vectorised backend is taken for by default."""

from __future__ import annotations

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.programs.repetition import MANY_NODES, REPETITIONS, repeats_large_rows


def waves(rows: int, terms: int) -> pyo.ConcreteModel:
    """Rows of one shape, each about 5 nodes for a term."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(rows), initialize=0.3)
    m.row = pyo.Constraint(range(rows), rule=lambda m, k: sum(pyo.sin(m.x[k] + i) for i in range(terms)) <= terms)
    m.cost = pyo.Objective(expr=sum((x - k / rows) ** 2 for k, x in m.x.items()))
    return m


def test_many_rows_of_one_large_shape_are_many_repetitions():
    assert repeats_large_rows(waves(100, MANY_NODES // 300))


def test_few_repetitions_are_not():
    assert not repeats_large_rows(waves(REPETITIONS - 1, MANY_NODES))


def test_small_models_are_not():
    assert not repeats_large_rows(waves(100, 5))


def test_rows_that_are_inactive_or_linear_do_not_count():
    m = waves(100, MANY_NODES // 300)
    m.row.deactivate()
    m.y = pyo.Var(range(50))
    m.linear = pyo.Constraint(
        range(1000), rule=lambda m, k: sum(k * y / 3.0 - 2.0 * (y - 1) for y in m.y.values()) <= 1
    )
    assert not repeats_large_rows(m)


def test_different_rows_are_no_repetitions():
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=0.3)
    m.rows = pyo.ConstraintList()
    for count in range(2, 200):
        m.rows.add(sum(pyo.sin(m.x + i) for i in range(count)) <= count)
    assert not repeats_large_rows(m)


def test_named_expressions_count_wherever_they_are_used():
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=0.3)
    m.wave = pyo.Expression(expr=sum(pyo.sin(m.x + i) for i in range(200)))
    m.rows = pyo.Constraint(range(100), rule=lambda m, k: m.wave * m.x <= k)
    assert repeats_large_rows(m)


def test_external_functions_are_left_to_asl():
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=0.3)
    m.outside = pyo.ExternalFunction(library="nowhere.so", function="f")
    m.call = pyo.Constraint(expr=m.outside(m.x) <= 1.0)
    m.inner = waves(100, MANY_NODES // 300)
    assert repeats_large_rows(m.inner)
    assert not repeats_large_rows(m)


@pytest.mark.ipopt
@pytest.mark.asl
@pytest.mark.casadi
@pytest.mark.parametrize(("terms", "expected"), [(MANY_NODES // 300, "vectorised"), (5, "ASL")])
def test_solve_takes_what_fits_the_model_and_what_was_asked_for(terms, expected):
    m = waves(100, terms)
    result = rcp.solve(m, polish=False)
    assert result.quality is rcp.Quality.OPTIMAL
    assert expected in result.derivatives
    assert "ASL" in rcp.solve(m, backend="asl").derivatives
