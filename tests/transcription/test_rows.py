"""Rows and quadrature, without a phase around them."""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo
import pytest

from pyrobocop_pyomo.numerics import Grid, Mesh, gauss_legendre, radau
from pyrobocop_pyomo.transcription import collocation_rows, continuity_rows, quadrature

SCHEMES = [scheme(stages) for stages in (1, 2, 5) for scheme in (radau, gauss_legendre)]
GRIDS = [Grid(scheme, Mesh.given([-1, 0.2, 0.5, 2])) for scheme in SCHEMES]
each_grid = pytest.mark.parametrize("grid", GRIDS, ids=lambda grid: str(grid.scheme))


def state_on(grid: Grid, polynomial: np.polynomial.Polynomial) -> pyo.Var:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(grid.times, initialize={t: polynomial(t) for t in grid.times})
    m.x.owner = m  # Pyomo holds parents by weak references
    return m.x


@each_grid
def test_rows_vanish_on_polynomials_of_the_degree_of_the_scheme_and_not_beyond(grid: Grid) -> None:
    s = grid.scheme.stages
    for degree in (s, s + 2):
        polynomial = np.polynomial.Polynomial(np.arange(1, degree + 2) / 10)
        x = state_on(grid, polynomial)
        rate = {t: polynomial.deriv()(t) for t in grid.points}
        rows = [*collocation_rows(x, rate, grid, grid.mesh.widths.tolist()), *continuity_rows(x, grid)]
        bodies = [pyo.value(body) for _, (body, _) in rows]
        assert all(bound == 0 for _, (_, bound) in rows)
        if degree == s:
            assert bodies == pytest.approx([0] * len(bodies), abs=1e-12)
        else:
            assert max(map(abs, bodies)) > 1e-6


@each_grid
def test_there_is_a_row_per_point_and_a_continuity_only_where_the_end_is_no_stage(grid: Grid) -> None:
    x = state_on(grid, np.polynomial.Polynomial([1.0]))
    rate = dict.fromkeys(grid.points, 0.0)
    assert [t for t, _ in collocation_rows(x, rate, grid, [1.0] * 3)] == list(grid.points)
    ends = [] if grid.scheme.stiffly_accurate else list(grid.mesh.boundaries[1:])
    assert [t for t, _ in continuity_rows(x, grid)] == ends


@each_grid
def test_quadrature_is_exact_below_the_order(grid: Grid) -> None:
    for degree in range(min(grid.scheme.order, 8)):
        expected = (2.0 ** (degree + 1) - (-1.0) ** (degree + 1)) / (degree + 1)
        assert quadrature(lambda t, degree=degree: t**degree, grid.quadrature_weights) == pytest.approx(
            expected, abs=1e-12
        )
    assert quadrature(lambda t: 1.0, {0.0: 0.5, 1.0: 1.0}) == pytest.approx(1.5)
