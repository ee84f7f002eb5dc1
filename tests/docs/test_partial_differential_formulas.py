"""The formulas of the page on partial differential equations."""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyomo.core.expr.visitor import identify_variables

from pyrobocop_pyomo.continuous.line_ends import closing_rows, rows_from_left
from pyrobocop_pyomo.numerics import Grid, Mesh, find_scheme


def values_on(grid, polynomial):
    m = pyo.ConcreteModel()
    m.t = pyo.Set(initialize=grid.times)
    m.x, m.a = pyo.Var(m.t), pyo.Var(m.t)
    for t in grid.times:
        m.x[t].set_value(float(polynomial(t)))
        m.a[t].set_value(float(polynomial.deriv()(t)))
    return m


@given(st.integers(1, 4), st.lists(st.floats(-3, 3), min_size=1, max_size=5), st.floats(0.2, 2))
@settings(max_examples=25, deadline=None)
def test_rows_from_the_left_hold_for_polynomials_of_the_degree_of_the_stages(stages, coefficients, middle):
    grid = Grid(find_scheme("radau", stages), Mesh((0.0, middle, 3.0)))
    m = values_on(grid, np.polynomial.Polynomial(coefficients[: stages + 1]))
    rows = list(rows_from_left(m.x, m.a, grid, grid.mesh.widths.tolist()))
    assert sorted(time for time, _ in rows) == list(grid.times[1:])
    assert max(abs(pyo.value(row)) for _, (row, _) in rows) < 1e-7
    assert 3.0 not in {
        v.index() for _, (row, _) in rows for v in identify_variables(row) if v.parent_component() is m.a
    }


@pytest.mark.parametrize("scheme", ["radau", "lobatto"])
@pytest.mark.parametrize("stages", [2, 3, 4])
def test_closing_row_takes_one_degree(scheme, stages):
    grid = Grid(find_scheme(scheme, stages), Mesh((0.0, 0.5, 3.0)))
    for degree, holds in ((stages - 2, True), (stages - 1, False)):
        m = values_on(grid, np.polynomial.Polynomial([1.0] * (degree + 1)).integ())
        rows = list(closing_rows(m.a, grid, (grid.points[0], grid.points[-1])))
        assert len(rows) == 2
        assert all((abs(pyo.value(row)) < 1e-9) is holds for _, (row, _) in rows)
