"""Lagrange bases on a few nodes in [0, 1]: values, derivatives and integrals as matrices.

Everything goes through barycentric weights, which keep full precision where monomials lose it: a dozen nodes
differentiate polynomials of their degree to about 1e-12.

Polynomials on [0, 1] by their Bernstein coefficients, whose smallest and largest enclose the polynomial.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Array


def barycentric_weights(nodes: ArrayLike) -> Array:
    """Weights ``w[j] = 1 / prod_{k != j} (nodes[j] - nodes[k])``, shape ``(n,)``.

    References
    ----------
    Berrut & Trefethen, Barycentric Lagrange interpolation, eq. (3.2), doi:10.1137/S0036144502417715
    """
    nodes = np.asarray(nodes, dtype=float)
    gaps = nodes[:, None] - nodes[None, :]
    np.fill_diagonal(gaps, 1.0)
    return 1.0 / gaps.prod(axis=1)


def evaluation_matrix(nodes: ArrayLike, at: ArrayLike) -> Array:
    """Matrix ``E`` with ``p(at) = E @ p(nodes)`` for every polynomial of degree below ``len(nodes)``.

    Parameters
    ----------
    nodes : array, shape (n,)
        Distinct interpolation nodes.
    at : array, shape (m,)
        Where to evaluate.

    Returns
    -------
    array, shape (m, n)
        ``E[i, j]`` is the Lagrange polynomial of node ``j`` at ``at[i]``.
    """
    nodes, at = np.asarray(nodes, dtype=float), np.atleast_1d(np.asarray(at, dtype=float))
    gaps = at[:, None] - nodes[None, :]
    # On a node the barycentric quotient is infinite, and closer than this it overflows: a unit vector there.
    hits = np.abs(gaps) < 1e-200
    matrix = hits.astype(float)
    between = ~hits.any(axis=1)
    terms = barycentric_weights(nodes) / gaps[between]
    matrix[between] = terms / terms.sum(axis=1, keepdims=True)
    return matrix


def differentiation_matrix(nodes: ArrayLike, at: ArrayLike | None = None) -> Array:
    """Matrix ``D`` with ``p'(at) = D @ p(nodes)`` for every polynomial of degree below ``len(nodes)``.

    Parameters
    ----------
    nodes : array, shape (n,)
        Distinct interpolation nodes.
    at : array, shape (m,), optional
        Where to differentiate; the nodes themselves by default.

    Returns
    -------
    array, shape (m, n)

    References
    ----------
    Berrut & Trefethen, Barycentric Lagrange interpolation, eqs. (9.4)-(9.5), doi:10.1137/S0036144502417715
    """
    nodes = np.asarray(nodes, dtype=float)
    weights = barycentric_weights(nodes)
    gaps = nodes[:, None] - nodes[None, :]
    np.fill_diagonal(gaps, 1.0)
    matrix = (weights[None, :] / weights[:, None]) / gaps
    np.fill_diagonal(matrix, 0.0)
    # A constant has derivative zero: the diagonal as minus the row sum keeps that exact to rounding.
    np.fill_diagonal(matrix, -matrix.sum(axis=1))
    if at is None:
        return matrix
    # p' has lower degree than p, so its values at the nodes determine it everywhere.
    return evaluation_matrix(nodes, at) @ matrix


def integration_matrix(nodes: ArrayLike, upper: ArrayLike) -> Array:
    """Matrix ``A`` with ``integral of p over [0, upper[i]] = A[i] @ p(nodes)``.

    Exact for polynomials of degree below ``len(nodes)``: each integral is a Gauss-Legendre sum with
    enough points, which never forms monomials.

    Parameters
    ----------
    nodes : array, shape (n,)
        Distinct interpolation nodes.
    upper : array, shape (m,)
        Upper limits.

    Returns
    -------
    array, shape (m, n)
    """
    nodes, upper = np.asarray(nodes, dtype=float), np.atleast_1d(np.asarray(upper, dtype=float))
    gauss, weights = np.polynomial.legendre.leggauss(max(1, (len(nodes) + 1) // 2))
    unit, unit_weights = (gauss + 1.0) / 2.0, weights / 2.0
    return np.array([end * (unit_weights @ evaluation_matrix(nodes, end * unit)) for end in upper])


def gauss_rule(breaks: Array) -> tuple[Array, Array]:
    """Points and weights of a rule on [0, 1]: Gauss's rule of three points on each part between breaks."""
    points, weights = np.polynomial.legendre.leggauss(3)
    middles, halves = (breaks[1:] + breaks[:-1])[:, None] / 2.0, np.diff(breaks)[:, None] / 2.0
    return (middles + halves * points).ravel(), (halves * weights).ravel()


# ------------------------------------------------------------------------------------------------------------ Bernstein


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
