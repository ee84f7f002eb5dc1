"""Bernstein coefficients: they say the same as the polynomial, on [0, 1] and on its parts, and enclose it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pyrobocop_pyomo.numerics.bernstein import (
    bernstein_from_samples,
    bernstein_matrix,
    derivative_coefficients,
    restrict,
)

degrees = st.integers(0, 9)
seeds = st.integers(0, 10**6)


def values(coefficients: np.ndarray, at: np.ndarray) -> np.ndarray:
    return bernstein_matrix(len(coefficients) - 1, at) @ coefficients


@given(degree=degrees)
def test_the_polynomials_sum_to_one_and_are_not_negative(degree: int) -> None:
    matrix = bernstein_matrix(degree, np.linspace(0, 1, 11))
    assert matrix.sum(axis=1) == pytest.approx(1.0)
    assert matrix.min() >= 0.0


@given(degree=degrees, seed=seeds)
def test_samples_give_back_the_coefficients(degree: int, seed: int) -> None:
    coefficients = np.random.default_rng(seed).normal(size=degree + 1)
    points, matrix = bernstein_from_samples(degree)
    assert matrix @ values(coefficients, points) == pytest.approx(coefficients, abs=1e-10)


@given(degree=degrees, seed=seeds, ends=st.tuples(st.floats(0, 1), st.floats(0, 1)))
def test_a_part_is_the_same_polynomial(degree: int, seed: int, ends: tuple[float, float]) -> None:
    coefficients = np.random.default_rng(seed).normal(size=degree + 1)
    part = restrict(coefficients[None, :], [ends[0]], [ends[1]])[0]
    local = np.linspace(0, 1, 7)
    wanted = values(coefficients, ends[0] + local * (ends[1] - ends[0]))
    assert values(part, local) == pytest.approx(wanted, abs=1e-12)
    assert part.min() - 1e-13 <= wanted.min()
    assert wanted.max() <= part.max() + 1e-13


@given(degree=st.integers(1, 9), seed=seeds)
def test_the_derivative_is_that_of_numpys_polynomial(degree: int, seed: int) -> None:
    coefficients = np.random.default_rng(seed).normal(size=degree + 1)
    at = np.linspace(0, 1, degree + 1)
    polynomial = np.polynomial.Polynomial.fit(at, values(coefficients, at), degree)
    assert values(derivative_coefficients(coefficients), at) == pytest.approx(polynomial.deriv()(at), abs=1e-7)


def test_a_constant_has_no_slope() -> None:
    assert derivative_coefficients(np.array([[3.0]])).tolist() == [[0.0]]
