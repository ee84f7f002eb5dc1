"""The numbered formulas of the page on the structural index, evaluated against the code."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.diagnosis import Severity, Subject
from pyrobocop_pyomo.numerics import maximum_matching
from pyrobocop_pyomo.phases.structure import PointStructure, middle_point

shapes = st.tuples(st.integers(1, 4), st.integers(1, 4), st.integers(0, 10_000), st.floats(0.2, 1.0))


def sparse(random: np.random.Generator, rows: int, columns: int, density: float) -> np.ndarray:
    return random.standard_normal((rows, columns)) * (random.uniform(size=(rows, columns)) < density)


@given(shapes)
def test_eliminating_given_derivatives_keeps_the_rank(shape: tuple[int, int, int, float]) -> None:
    """eq-substituted: rank of [[I, -f_y], [r_xdot, r_y]] is n_x + rank(r_y + r_xdot f_y)."""
    states, algebraics, seed, density = shape
    random = np.random.default_rng(seed)
    f_y = sparse(random, states, algebraics, density)
    r_rate, r_y = sparse(random, algebraics, states, density), sparse(random, algebraics, algebraics, density)
    whole = np.block([[np.eye(states), -f_y], [r_rate, r_y]])
    reduced = r_y + r_rate @ f_y
    assert np.linalg.matrix_rank(whole, tol=1e-9) == states + np.linalg.matrix_rank(reduced, tol=1e-9)


@given(shapes)
def test_the_rank_is_at_most_the_size_of_a_maximum_matching(shape: tuple[int, int, int, float]) -> None:
    """eq-structural-rank, with equality for almost all numbers."""
    rows, columns, seed, density = shape
    matrix = sparse(np.random.default_rng(seed), rows, columns, density)
    matching = maximum_matching([np.flatnonzero(row).tolist() for row in matrix], columns)
    size = rows - len(matching.unmatched_rows)
    assert np.linalg.matrix_rank(matrix) == size
    cancelled = np.ones_like(matrix) * (matrix != 0)
    assert np.linalg.matrix_rank(cancelled) <= size


def forces(second: Any) -> Any:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(elements=3)
    b.x = rcp.State(initial=1)
    b.y, b.z = rcp.Algebraic(), rcp.Algebraic()
    b.ode(lambda b, t: {b.x: b.y[t] + 3 * b.z[t]})

    def balance(b: Any, t: float) -> Any:
        return [b.y[t] + b.z[t] == b.x[t], second(b, t)]

    b.residual(balance)
    return m


@pytest.mark.parametrize(("factor", "regular"), [(2.0, False), (2.5, True)])
def test_equations_that_cancel_are_missed_by_structure_and_found_by_numbers(factor: float, regular: bool) -> None:
    """eq-instant, eq-index-one: the example of the page, and a neighbour that is regular."""
    m = forces(lambda b, t: 2 * b.y[t] + factor * b.z[t] == 2 * b.x[t])
    m.p.check()
    structure = PointStructure(m.p, m.p.record, middle_point(m.p.record))
    assert structure.of_rows.unmatched_rows == []
    found = rcp.diagnose(m).about(Subject.DEPENDENT)
    assert bool(found) is not regular
    if regular:
        return
    assert np.linalg.matrix_rank(np.array([[1, 1], [2, factor]])) == 1


@pytest.mark.parametrize(("final", "severity"), [(1.0, Severity.WARNING), (2.0, Severity.ERROR)])
def test_dependent_rows_over_the_horizon_contradict_each_other_where_residuals_do(
    final: float, severity: Severity
) -> None:
    """eq-left-null: x' = y' = u from 0 to 1 and to `final`; with equal ends one row too many, else a wrong one."""
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(elements=4)
    b.x, b.y, b.u = rcp.State(initial=0, final=1), rcp.State(initial=0, final=final), rcp.Control()
    b.ode(lambda b, t: {b.x: b.u[t], b.y: b.u[t]})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    (finding,) = rcp.diagnose(m).findings
    assert finding.severity is severity
    assert finding.subject is (Subject.CONTRADICTION if severity is Severity.ERROR else Subject.DEPENDENT)
