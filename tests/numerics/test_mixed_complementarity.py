"""Mixed complementarity problems are solved, by each way alone where its theory says so, and a failure says so."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pyrobocop_pyomo.numerics.mixed_complementarity import (
    ComplementarityValues,
    MixedComplementarity,
    solve_mixed_complementarity,
)


def linear(matrix, offset, lower, upper, rows=None) -> MixedComplementarity:
    """``l <= z <= u ⟂ M z + q``, with rows ``C z = d`` in front for unknowns that no statement bounds."""
    count, size = len(lower), matrix.shape[1]
    equations, right = (np.zeros((0, size)), np.zeros(0)) if rows is None else rows

    def evaluate(z):
        body = np.eye(size)[:count]
        return ComplementarityValues(equations @ z - right, z[:count], matrix @ z + offset, equations, body, matrix)

    return MixedComplementarity(evaluate, lower, upper, np.zeros(count, dtype=bool))


@given(seed=st.integers(0, 10_000), count=st.integers(1, 8), free=st.integers(0, 3))
@settings(max_examples=60, deadline=None)
def test_monotone_problems_have_the_solution_that_is_found(seed: int, count: int, free: int) -> None:
    random = np.random.default_rng(seed)
    size = count + free
    factor = random.normal(size=(size, size))
    whole = factor @ factor.T + 0.1 * np.eye(size)
    offset = random.normal(size=size)
    lower = np.where(random.random(count) < 0.8, 0.0, -np.inf)
    upper = np.where((random.random(count) < 0.3) | np.isinf(lower), 1.0, np.inf)
    problem = linear(whole[:count], offset[:count], lower, upper, (whole[count:], -offset[count:]))
    start = random.normal(size=size)
    found = solve_mixed_complementarity(problem, start)
    assert found.solved
    z, h = found.point[:count], (whole @ found.point + offset)[:count]
    assert (z >= lower - 1e-8).all()
    assert (z <= upper + 1e-8).all()
    assert (np.abs(h[(z > lower + 1e-6) & (z < upper - 1e-6)]) < 1e-6).all()
    assert (h[z < np.minimum(upper, lower + 1e-9)] >= -1e-6).all()
    assert (h[z > upper - 1e-9] <= 1e-6).all()


def test_of_several_solutions_the_near_one_is_taken_and_of_none_the_best_point() -> None:
    # 0 <= z ⟂ 1 - z >= 0 holds at 0 and at 1.
    several = linear(np.array([[-1.0]]), np.array([1.0]), np.zeros(1), np.full(1, np.inf))
    assert solve_mixed_complementarity(several, np.array([0.1])).point[0] == pytest.approx(0)
    assert solve_mixed_complementarity(several, np.array([0.9])).point[0] == pytest.approx(1)
    nothing = linear(np.array([[-1.0]]), np.array([-1.0]), np.zeros(1), np.full(1, np.inf))
    found = solve_mixed_complementarity(nothing, np.array([0.5]))
    assert not found.solved
    assert found.residual > 0.1
    assert found.worst == 0


def test_a_product_of_any_sign() -> None:
    """``z >= 0`` and ``z (z - 2 + s) = 0``, where s is an unknown of its own: s = 3 + z."""

    def evaluate(point):
        z, s = point
        return ComplementarityValues(
            np.array([s - 3 - z]), np.array([z]), np.array([z - 2 + s]),
            np.array([[-1.0, 1.0]]), np.array([[1.0, 0.0]]), np.array([[1.0, 1.0]]),
        )  # fmt: skip

    problem = MixedComplementarity(evaluate, np.zeros(1), np.full(1, np.inf), np.ones(1, dtype=bool))
    found = solve_mixed_complementarity(problem, np.array([1.0, 0.0]))
    np.testing.assert_allclose(found.point, [0.0, 3.0], atol=1e-9)  # z = -1/2 is not allowed


def test_where_a_function_has_no_value_another_way_goes_on() -> None:
    """``exp(z) = 2`` from far away, where exp overflows."""

    def evaluate(point):
        if abs(point[0]) > 50:
            raise OverflowError
        size = np.exp(point)
        return ComplementarityValues(
            size - 2, np.zeros(0), np.zeros(0), np.diag(size), np.zeros((0, 1)), np.zeros((0, 1))
        )

    problem = MixedComplementarity(evaluate, np.zeros(0), np.zeros(0), np.zeros(0, dtype=bool))
    found = solve_mixed_complementarity(problem, np.array([-6.0]))
    assert found.point[0] == pytest.approx(np.log(2))
