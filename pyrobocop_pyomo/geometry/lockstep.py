"""Signed distances of many pairs of point sets at once: the same steps for all, in whole arrays.

Each pair keeps at most as many differences ``p_i - q_j`` as there are dimensions, and takes the newest and those of
the others whose combination is nearest to the origin, found by trying all subsets (Gilbert, Johnson, Keerthi).
What the steps leave open (pairs that touch or overlap, and the few that rounding keeps from ending) is settled
pair by pair, so that the answers are those of `distance_of_points`.

References
----------
Gilbert, E. G., Johnson, D. W., Keerthi, S. S. (1988). A fast procedure for computing the distance between complex
objects in three-dimensional space. IEEE Journal on Robotics and Automation 4(2), 193-203.
https://doi.org/10.1109/56.2083
"""

from __future__ import annotations

import itertools

import numpy as np

from .distance import TOUCHING, distance_of_points

LARGEST_COUNT = 25
# Relative to the scene: a gap along the normal this close to the distance proves the distance.
PROVEN = 1e-13
# What is still taken after the last step; the rest goes pair by pair.
ACCEPTED = 1e-11


def distances_of_points(
    p: np.ndarray, q: np.ndarray, p_rays: np.ndarray | None = None, q_rays: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Signed distances of m pairs of convex hulls, see `distance_of_points`; nothing is checked.

    Parameters
    ----------
    p, q : (m, v, d) and (m, w, d) arrays
        Corners in the world of the first and the second body of each pair.
    p_rays, q_rays : (m, k, d) arrays, optional
        Unit rows. With rays, each pair is settled by itself.

    Returns
    -------
    distance : (m,) array
    normal : (m, d) array
        Unit vectors from the second to the first bodies, along which the gaps are the distances.
    """
    distance, normal = np.full(len(p), np.nan), np.full((len(p), p.shape[2]), np.nan)
    has_rays = any(rays is not None and rays.shape[1] > 0 for rays in (p_rays, q_rays))
    if not has_rays and len(p):
        _settle_those_apart(p, q, distance, normal)
    for k in np.flatnonzero(np.isnan(distance)):
        alone = distance_of_points(
            p[k], q[k], None if p_rays is None else p_rays[k], None if q_rays is None else q_rays[k]
        )
        distance[k], normal[k] = alone.distance, alone.normal
    return distance, normal


def _settle_those_apart(p: np.ndarray, q: np.ndarray, distance: np.ndarray, normal: np.ndarray) -> None:
    """Fill in the pairs whose gap proves their distance."""
    origin = 0.5 * (p[:, :1] + q[:, :1])
    p, q = p - origin, q - origin
    scale = np.maximum(np.abs(p).max(axis=(1, 2)), np.abs(q).max(axis=(1, 2)))
    pairs = np.arange(len(p))
    nearest = _lowest(p, q, p.mean(axis=1) - q.mean(axis=1))
    kept = np.full((len(p), p.shape[2], p.shape[2]), np.nan)  # rows of nan: places that are free
    kept[:, 0] = nearest
    for count in range(LARGEST_COUNT):
        norm = np.linalg.norm(nearest, axis=1)
        lowest = _lowest(p, q, nearest)
        with np.errstate(invalid="ignore", divide="ignore"):  # norms of zero: not apart, and left out below
            along = nearest / norm[:, None]
            short_by = norm - (lowest * along).sum(axis=1)
        apart = norm > TOUCHING * scale
        proven = apart & (short_by <= (PROVEN if count < LARGEST_COUNT - 1 else ACCEPTED) * scale)
        distance[pairs[proven]], normal[pairs[proven]] = norm[proven], along[proven]
        going = apart & ~proven
        if not going.any():
            return
        pairs, p, q, scale, kept, lowest = (a[going] for a in (pairs, p, q, scale, kept, lowest))
        nearest, kept = _nearest_with(lowest, kept)


def _lowest(p: np.ndarray, q: np.ndarray, directions: np.ndarray) -> np.ndarray:
    every = np.arange(len(p))
    i = np.matmul(p, directions[:, :, None])[:, :, 0].argmin(axis=1)
    j = np.matmul(q, directions[:, :, None])[:, :, 0].argmax(axis=1)
    return p[every, i] - q[every, j]


def _nearest_with(newest: np.ndarray, kept: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nearest points to the origin of the simplices of the newest (m, d) and the kept (m, d, d), and what they need."""
    dimension = newest.shape[1]
    best, best_square = newest, (newest * newest).sum(axis=1)
    best_kept = np.full_like(kept, np.nan)
    best_kept[:, 0] = newest
    for size in range(1, dimension + 1):
        for subset in itertools.combinations(range(dimension), size):
            point, inside = _affine_minimum(newest, kept[:, subset])
            square = (point * point).sum(axis=1)
            # Of as many points as there are dimensions and one more, the inside holds the origin: an overlap.
            square = np.where(size == dimension, 0.0, square)
            better = inside & (square < best_square)
            if not better.any():
                continue
            best = np.where(better[:, None], point if size < dimension else 0.0, best)
            best_square = np.where(better, square, best_square)
            held = np.full_like(kept, np.nan)
            held[:, 0] = newest
            held[:, 1 : size + 1] = kept[:, subset[: dimension - 1]]
            best_kept = np.where(better[:, None, None], held, best_kept)
    return best, best_kept


def _affine_minimum(base: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nearest points of the affine hulls, and whether all weights there are positive; by orthogonalisation."""
    size = others.shape[1]
    point = base
    axes: list[np.ndarray] = []
    aims: list[np.ndarray] = []
    triangle = np.zeros((len(base), size, size))
    with np.errstate(invalid="ignore", divide="ignore"):  # free places, and points that others span: not inside
        for k in range(size):
            rest = others[:, k] - base
            for row, axis in enumerate(axes):
                triangle[:, row, k] = (axis * rest).sum(axis=1)
                rest = rest - triangle[:, row, k, None] * axis
            triangle[:, k, k] = np.sqrt((rest * rest).sum(axis=1))
            axes.append(rest / triangle[:, k, k, None])
            aims.append(-(axes[k] * point).sum(axis=1))
            point = point + aims[k][:, None] * axes[k]
        weights = np.zeros((len(base), size))
        for row in reversed(range(size)):
            known = (triangle[:, row, row + 1 :] * weights[:, row + 1 :]).sum(axis=1)
            weights[:, row] = (aims[row] - known) / triangle[:, row, row]
        inside = (weights > 0.0).all(axis=1) & (weights.sum(axis=1) < 1.0)
    return point, inside
