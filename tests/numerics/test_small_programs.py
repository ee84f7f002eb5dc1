"""Stationary points of small quadratic programs meet the conditions of optimality, all side by side."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pyrobocop_pyomo.numerics.small_programs import solve_small_programs

INFINITE = np.inf


@given(seed=st.integers(0, 10_000), n=st.integers(1, 4), m=st.integers(0, 2), count=st.integers(1, 5))
def test_what_is_found_meets_the_conditions_of_optimality(seed: int, n: int, m: int, count: int) -> None:
    random = np.random.default_rng(seed)
    root = random.normal(size=(count, n, n))
    curvature = root @ root.transpose(0, 2, 1) + np.eye(n)
    slope = random.normal(size=(count, n))
    room = (np.full((count, n), -1.0), np.full((count, n), 1.5))
    rows = random.normal(size=(count, m, n))
    sides = (np.full((count, m), -0.3), np.full((count, m), 0.4))  # zero meets them all
    d, found = solve_small_programs(curvature, slope, room, rows, sides)
    value = np.einsum("pij,pj->pi", rows, d)
    for p in np.flatnonzero(found):
        assert (d[p] >= room[0][p] - 1e-8).all()
        assert (d[p] <= room[1][p] + 1e-8).all()
        assert (value[p] >= sides[0][p] - 1e-8).all()
        assert (value[p] <= sides[1][p] + 1e-8).all()
        # No feasible point near by is better; the program is convex, so none is.
        level = slope[p] @ d[p] + 0.5 * d[p] @ curvature[p] @ d[p]
        for other in random.uniform(-1.0, 1.5, size=(50, n)):
            at = rows[p] @ other
            if (at >= sides[0][p]).all() and (at <= sides[1][p]).all():
                assert slope[p] @ other + 0.5 * other @ curvature[p] @ other >= level - 1e-8


def test_an_equation_leaves_the_directions_that_it_says() -> None:
    # d_0 + d_1 = 1, with a curvature that is negative across it.
    curvature = np.array([[[1.0, 2.0], [2.0, 1.0]]])
    one = np.array([[1.0]])
    free = (np.full((1, 2), -INFINITE), np.full((1, 2), INFINITE))
    d, found = solve_small_programs(
        curvature + np.array([[[3.0, 0.0], [0.0, 3.0]]]), np.zeros((1, 2)), free, np.ones((1, 1, 2)), (one, one)
    )
    assert found.all()
    assert d[0] == pytest.approx([0.5, 0.5])


def test_bounds_and_rows_are_met_together() -> None:
    # As near to (2, 2) as x <= 0.5 and x + y <= 1 allow.
    room = (np.full((1, 2), -INFINITE), np.array([[0.5, INFINITE]]))
    sides = (np.full((1, 1), -INFINITE), np.array([[1.0]]))
    d, found = solve_small_programs(np.eye(2)[None], np.array([[-2.0, -2.0]]), room, np.ones((1, 1, 2)), sides)
    assert found.all()
    assert d[0] == pytest.approx([0.5, 0.5])


def test_what_has_no_bottom_is_not_called_found() -> None:
    free = (np.full((1, 1), -INFINITE), np.full((1, 1), INFINITE))
    d, found = solve_small_programs(
        np.zeros((1, 1, 1)), np.ones((1, 1)), free, np.zeros((1, 0, 1)), (np.zeros((1, 0)),) * 2
    )
    assert not found.any()
    assert not d.any()
