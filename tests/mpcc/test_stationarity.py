"""Kinds of stationarity, against their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from harness.quadratic_program import QuadraticProgram
from hypothesis import given
from hypothesis import strategies as st
from problems import sides

from pyrobocop_pyomo.mpcc.branch import Branch
from pyrobocop_pyomo.mpcc.linearisation import Linearisation
from pyrobocop_pyomo.mpcc.multipliers import MultiplierProblem, classify, strong_multipliers
from pyrobocop_pyomo.mpcc.problem import ComplementarityProgram
from pyrobocop_pyomo.mpcc.stationarity import Stationarity
from pyrobocop_pyomo.programs.nonlinear_program import PrimalDualPoint

TWO_MULTIPLIERS = st.tuples(st.sampled_from([-2.0, 0.0, 3.0]), st.sampled_from([-1.0, 0.0, 1.0]))


def kind_by_definition(nu, xi):
    """For unique multipliers at biactive pairs."""
    if (nu >= 0).all() and (xi >= 0).all():
        return Stationarity.S
    if (((nu > 0) & (xi > 0)) | (nu * xi == 0)).all():
        return Stationarity.M
    if (nu * xi >= 0).all():
        return Stationarity.C
    if ((nu >= 0) | (xi >= 0)).all():
        return Stationarity.A
    return Stationarity.W


def at(program, x):
    return MultiplierProblem(program, Linearisation.at(program.nlp, np.asarray(x, dtype=float)))


@given(signs=st.lists(TWO_MULTIPLIERS, min_size=1, max_size=4))
def test_without_constraints_the_gradient_is_the_multipliers(signs):
    nu, xi = np.array(signs).T
    k = len(signs)
    nlp = QuadraticProgram(np.concatenate([nu, xi]), x_lower=np.zeros(2 * k))
    program = ComplementarityProgram(nlp, sides(np.arange(k)), sides(k + np.arange(k)))
    found = classify(at(program, np.zeros(2 * k)))
    assert found.kind is kind_by_definition(nu, xi)
    np.testing.assert_allclose(found.nu, nu, atol=1e-6)
    np.testing.assert_allclose(found.xi, xi, atol=1e-6)


@given(signs=TWO_MULTIPLIERS)
def test_a_side_that_falls_with_its_variable_has_the_mirrored_multiplier(signs):
    """``0 <= 1 - x ⟂ y >= 0`` at x = 1: the multiplier of 1 - x is minus the slope in x."""
    nlp = QuadraticProgram(signs, x_lower=[-np.inf, 0], x_upper=[1, np.inf])
    program = ComplementarityProgram(nlp, sides(0, sign=-1.0, offset=1.0), sides(1))
    found = classify(at(program, [1.0, 0.0]))
    assert found.kind is kind_by_definition(np.array([-signs[0]]), np.array([signs[1]]))
    assert found.nu[0] == pytest.approx(-signs[0], abs=1e-6)


@given(slopes=st.tuples(st.floats(-3, 3), st.floats(-3, 3)))
def test_a_strictly_complementary_pair_asks_for_no_sign(slopes):
    """At x = 0, y = 1 with y at its upper bound, every slope of x is balanced; one of y only if it is not positive."""
    nlp = QuadraticProgram(slopes, x_lower=[0, 0], x_upper=[np.inf, 1])
    program = ComplementarityProgram(nlp, sides(0), sides(1))
    found = classify(at(program, [0.0, 1.0]))
    if slopes[1] <= 0:
        assert found.kind is Stationarity.S
        assert found.nu[0] == pytest.approx(slopes[0], abs=1e-6)
    elif slopes[1] > 1e-5:
        assert found.kind is Stationarity.NONE


def test_multipliers_are_a_matter_of_existence():
    """Two equal rows share a force in any way: some multipliers have wrong signs, others the right ones."""
    # At the origin: minimise x + y over x + y >= 0 (twice) and 0 <= x ⟂ y >= 0.
    nlp = QuadraticProgram([1, 1], A=[[1, 1], [2, 2]], g_lower=[0, 0], x_lower=[0, 0])
    program = ComplementarityProgram(nlp, sides(0), sides(1))
    assert classify(at(program, [0.0, 0.0])).kind is Stationarity.S


def test_a_row_that_repeats_a_side_has_no_multiplier_of_its_own():
    """Otherwise it could take the wrong sign off nu: minimise -y with x free of bounds, held by a row x >= 0."""
    nlp = QuadraticProgram([1, -1], A=[[1, 0]], g_lower=[0], x_lower=[-np.inf, 0])
    with_row = ComplementarityProgram(nlp, sides(0), sides(1))
    found = classify(at(with_row, [0.0, 0.0]))
    assert (found.kind, round(found.nu[0], 6), round(found.xi[0], 6)) == (Stationarity.A, 1.0, -1.0)


def test_a_solver_that_shares_the_multiplier_between_row_and_side_changes_nothing():
    """Minimise -y + (x + 3)^2 / 2 with x held at zero by the branch, and by a row x >= 0 that takes a part."""
    nlp = QuadraticProgram([3, 1], H=np.eye(2), A=[[2, 0]], g_lower=[0], x_lower=[-np.inf, 0])
    program = ComplementarityProgram(nlp, sides(0), sides(1))
    point = Linearisation.at(nlp, np.zeros(2))
    branch = Branch(np.array([True]), np.array([True]))
    for part in (0.0, 0.5, 1.5):
        solver = PrimalDualPoint(np.zeros(2), np.array([-part]), np.zeros(2), np.zeros(2))
        found = strong_multipliers(program, point, branch, solver, sizes=np.ones(2))
        assert found is not None
        assert (found.nu[0], found.xi[0]) == pytest.approx((3.0, 1.0))
