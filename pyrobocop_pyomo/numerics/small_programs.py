"""Many small quadratic programs at once, each with bounds, equations and inequalities."""

from __future__ import annotations

import numpy as np

from .arrays import Array

_SWEEPS = 25
_TIE, _SOLVED = 1e-12, 1e-9


def solve_small_programs(
    curvature: Array,
    slope: Array,
    room: tuple[Array, Array],
    rows: Array,
    sides: tuple[Array, Array],
    near: float = 0.0,
) -> tuple[Array, Array]:
    """Stationary points of ``slope . d + d . curvature . d / 2`` within bounds and rows.

    A primal-dual method of active sets, which is Newton's method for the conditions of optimality (Hintermueller, Ito
    & Kunisch, SIAM J. Optimization 13 (2002) 865, doi:10.1137/S1052623401383558); all programs go side by side. The
    curvature need only be positive in the directions that the rows leave free.

    Parameters
    ----------
    curvature : array, shape (P, n, n)
        Symmetric.
    slope : array, shape (P, n)
    room : pair of arrays, shape (P, n)
        Least and largest ``d``; infinite where there is none.
    rows : array, shape (P, m, n)
        Their coefficients.
    sides : pair of arrays, shape (P, m)
        Least and largest ``rows @ d``; both are the same for an equation.
    near : float
        Bounds and rows that are met within this distance from ``d = 0`` are taken as active first: of several
        stationary points, that next to zero is found. By default none is.

    Returns
    -------
    d : array, shape (P, n)
    found : array of bool, shape (P,)
        Where the method has ended; ``d`` is zero elsewhere.
    """
    count, n = slope.shape
    m = rows.shape[1]
    # Bounds are rows of their own, of which the matrix is the identity.
    every = np.concatenate([rows, np.broadcast_to(np.eye(n), (count, n, n))], axis=1)
    lower, upper = (np.concatenate([of_rows, of_room], axis=1) for of_rows, of_room in zip(sides, room, strict=True))
    equation = lower == upper
    size = np.abs(curvature).max(axis=(1, 2), initial=0.0) + 1e-300
    weight = size[:, None] / (np.square(every).sum(axis=2) + 1e-300)
    distance = near * np.sqrt(np.square(every).sum(axis=2))
    at_upper = equation | (np.abs(upper) < distance)
    at_lower = ~at_upper & (np.abs(lower) < distance)
    found, d, settled = np.zeros(count, dtype=bool), np.zeros((count, n)), np.zeros(count, dtype=bool)
    identity = np.eye(m + n)
    with np.errstate(all="ignore"):
        for _ in range(_SWEEPS):
            active = at_lower | at_upper
            bound = np.where(at_upper, np.where(np.isfinite(upper), upper, 0.0), np.where(at_lower, lower, 0.0))
            matrix = np.zeros((count, 2 * n + m, 2 * n + m))
            matrix[:, :n, :n] = curvature
            matrix[:, :n, n:] = every.transpose(0, 2, 1) * size[:, None, None]
            matrix[:, n:, :n] = np.where(active[:, :, None], every, 0.0)
            matrix[:, n:, n:] = np.where(active[:, :, None], 0.0, identity)
            right = np.concatenate([-slope, np.where(active, bound, 0.0)], axis=1)
            unknown = _solved(matrix, right)
            d, y = unknown[:, :n], unknown[:, n:] * size[:, None]
            value = np.einsum("pij,pj->pi", every, d)
            slack = _TIE * (1.0 + np.abs(value))
            now_upper = equation | (np.isfinite(upper) & (y + weight * (value - upper) > weight * slack))
            now_lower = ~now_upper & np.isfinite(lower) & (y + weight * (value - lower) < -weight * slack)
            settled = (now_upper == at_upper).all(axis=1) & (now_lower == at_lower).all(axis=1)
            # Rows that contradict or follow from each other leave a system that has no solution, or several.
            left = np.abs(np.einsum("pij,pj->pi", matrix, unknown) - right)
            settled &= (left <= _SOLVED * (1.0 + np.abs(right).max(axis=1))[:, None]).all(axis=1)
            at_upper, at_lower = now_upper, now_lower
            if settled.all():
                break
        found = settled
    return np.where(found[:, None], d, 0.0), found


def _solved(matrix: Array, right: Array) -> Array:
    """Each system by itself where some are singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, right[:, :, None])[:, :, 0])
    except np.linalg.LinAlgError:
        answers = np.full(right.shape, np.nan)
        for i, (of, side) in enumerate(zip(matrix, right, strict=True)):
            if np.isfinite(of).all():
                answers[i] = np.linalg.lstsq(of, side, rcond=None)[0]
        return answers
