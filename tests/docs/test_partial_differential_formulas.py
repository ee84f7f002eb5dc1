"""The formulas of the page on partial differential equations."""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyomo.core.expr.visitor import identify_variables
from scipy.linalg import eigvals

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


@pytest.mark.parametrize("stages", [1, 2, 3, 4])
@pytest.mark.parametrize("ends", ["uu", "uv", "vu"])
def test_heat_decays_with_a_closing_row(stages, ends):
    """Real negative eigenvalues; the first is that of the equation up to the error of the mesh."""
    scheme, elements = find_scheme("radau", stages), 6
    count, width = elements * stages + 1, 1 / elements
    rows, masses = [], []

    def add(entries, mass=None):
        row, right = np.zeros(3 * count), np.zeros(3 * count)
        for column, number in entries:
            row[column] += number
        if mass is not None:
            right[mass] = 1.0
        rows.append(row)
        masses.append(right)

    for element in range(elements):
        nodes = element * stages + np.arange(stages + 1)
        for above, below in ((0, count), (count, 2 * count)):
            for r in range(stages):
                entries = [*zip(above + nodes, scheme.D[r], strict=True)]
                add([*entries, *zip(below + nodes[1:], -width * scheme.F[r], strict=True)])
    for i in range(1, count - 1):
        add([(2 * count + i, 1.0)], mass=i)
    gaps = scheme.c[:, None] - scheme.c[None, :] + np.eye(stages)
    add([*zip(3 * count - stages + np.arange(stages), 1 / gaps.prod(axis=1), strict=True)])
    add([(2 * count, 1.0)])  # not used
    for end, at in zip(ends, (0, count - 1), strict=True):
        add([(at if end == "u" else count + at, 1.0)])
    found = eigvals(np.array(rows), np.array(masses))
    found = found[np.isfinite(found) & (np.abs(found) < 1e7)]
    assert len(found) >= (elements * stages) // 3
    assert np.abs(found.imag).max() < 1e-6 * np.abs(found).max()
    assert found.real.max() < 0
    if stages >= 2:
        exact = -(np.pi**2) if ends == "uu" else -(np.pi**2) / 4
        assert found.real.max() == pytest.approx(exact, rel=5e-3)
