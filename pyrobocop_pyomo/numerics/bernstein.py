"""Polynomials on [0, 1] by their Bernstein coefficients, whose smallest and largest enclose the polynomial."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Array


def bernstein_matrix(degree: int, at: ArrayLike) -> Array:
    """Values of the Bernstein polynomials of a degree, shape ``(len(at), degree + 1)``.

    Column ``k`` is ``binomial(degree, k) tau^k (1 - tau)^(degree - k)``.
    """
    tau = np.atleast_1d(np.asarray(at, dtype=float))[:, None]
    powers = np.arange(degree + 1)
    binomials = np.array([math.comb(degree, k) for k in range(degree + 1)], dtype=float)
    return np.asarray(binomials * tau**powers * (1.0 - tau) ** (degree - powers), dtype=np.float64)


@lru_cache(maxsize=32)
def bernstein_from_samples(degree: int) -> tuple[Array, Array]:
    """Points in [0, 1], and the matrix that turns a polynomial's values there into its Bernstein coefficients.

    Returns
    -------
    points : array, shape (degree + 1,)
        Chebyshev points, where the matrix is best conditioned.
    matrix : array, shape (degree + 1, degree + 1)
    """
    points = (1.0 - np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))) / 2.0
    matrix = np.asarray(np.linalg.inv(bernstein_matrix(degree, points)), dtype=np.float64)
    for shared in (points, matrix):
        shared.setflags(write=False)  # shared by all callers
    return points, matrix


def derivative_coefficients(coefficients: Array) -> Array:
    """Coefficients of the derivative along the last axis, of one degree less; of a constant: zero, degree 0."""
    degree = coefficients.shape[-1] - 1
    if degree == 0:
        return np.zeros_like(coefficients)
    return np.asarray(degree * np.diff(coefficients, axis=-1), dtype=np.float64)


def restrict(coefficients: Array, start: ArrayLike, end: ArrayLike) -> Array:
    """Coefficients on parts ``[start, end]`` of [0, 1], as polynomials of the local time of each part.

    Parameters
    ----------
    coefficients : array, shape (m, degree + 1)
    start, end : array, shape (m,)
        One part per polynomial.

    Notes
    -----
    Coefficient ``k`` is the blossom of the polynomial with ``degree - k`` arguments ``start`` and ``k`` arguments
    ``end``; de Casteljau's steps, convex combinations throughout, keep it accurate to a few roundings.
    """
    degree = coefficients.shape[-1] - 1
    start, end = np.asarray(start, dtype=float)[:, None], np.asarray(end, dtype=float)[:, None]
    restricted = np.empty_like(coefficients)
    # After r steps with `start`, `head` has the blossoms with r arguments `start`; each is then closed with `end`.
    head = coefficients
    for r in range(degree + 1):
        tail = head
        for _ in range(degree - r):
            tail = (1.0 - end) * tail[:, :-1] + end * tail[:, 1:]
        restricted[:, degree - r] = tail[:, 0]
        head = (1.0 - start) * head[:, :-1] + start * head[:, 1:]
    return restricted
