"""Derivatives of a solution on arrays: the law of the implicit function, and refusals where it does not hold."""

import numpy as np
import pytest
from harness.quadratic_program import QuadraticProgram

from pyrobocop_pyomo.contrib.sensitivity.derivatives import derivatives
from pyrobocop_pyomo.errors import EvaluationError


def named(number: int) -> str:
    return f"constraint {number}"


def tracking(p: float, **bounds) -> QuadraticProgram:
    """Minimise (x - p)^2 / 2 over x with the parameter p as the second variable."""
    return QuadraticProgram([0, 0], H=[[1, -1], [-1, 1]], **bounds)


def test_an_inactive_bound_nearby_does_not_hold():
    nlp = tracking(1.0 + 1e-5, x_lower=[1.0, -np.inf])
    found = derivatives(nlp, np.array([1.0 + 1e-5, 1.0 + 1e-5]), np.array([1]), named)
    assert found.variables[0, 0] == pytest.approx(1.0)


def test_a_bound_that_repeats_an_equation_does_not_count_twice():
    nlp = tracking(2.0, A=[[3.0, 0.0]], g_lower=[0.0], g_upper=[0.0], x_lower=[0.0, -np.inf])
    found = derivatives(nlp, np.array([0.0, 2.0]), np.array([1]), named)
    assert list(found.active) == [0]
    assert found.variables[0, 0] == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("distance", [0.0, 1e-9, 3e-5])
def test_a_bound_without_a_multiplier_is_refused_by_name(distance):
    """Also where an interior-point method stopped beside it."""
    nlp = tracking(1.0, x_lower=[1.0, -np.inf])
    with pytest.raises(EvaluationError, match=r"strict complementarity fails: 1 inequalities .* constraint 0"):
        derivatives(nlp, np.array([1.0 + distance, 1.0]), np.array([1]), named)


@pytest.mark.parametrize("moves", [0.0, 1.0])
def test_dependent_equations_are_refused_by_name_where_they_move_apart(moves):
    rows = [[1, 1, 0, 0], [0, 1, 1, -moves], [1, 2, 1, -moves]]
    nlp = QuadraticProgram([0] * 4, H=np.eye(4), A=rows, g_lower=[0] * 3, g_upper=[0] * 3)
    found = derivatives(nlp, np.zeros(4), np.array([3]), named)
    assert found.variables[:3, 0] == pytest.approx(moves * np.array([-1, 1, 2]) / 3)
    rows[2][3] = 1
    nlp = QuadraticProgram([0] * 4, H=np.eye(4), A=rows, g_lower=[0] * 3, g_upper=[0] * 3)
    with pytest.raises(EvaluationError, match=r"linearly dependent.*among them: constraint 0, constraint 1"):
        derivatives(nlp, np.zeros(4), np.array([3]), named)


def test_a_flat_direction_is_refused_by_name():
    nlp = QuadraticProgram([0, 0, 0], H=np.diag([1.0, 0.0, 1.0]))
    with pytest.raises(EvaluationError, match=r"the solution is not unique"):
        derivatives(nlp, np.zeros(3), np.array([2]), named)


def test_a_point_that_is_no_solution_is_refused():
    with pytest.raises(EvaluationError, match=r"moves constraint 0 from 0 to 2"):
        derivatives(tracking(2.0), np.array([0.0, 2.0]), np.array([1]), named)
