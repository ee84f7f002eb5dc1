"""The point nearest to the origin among the differences of two point sets: Wolfe's method, on supports only.

The differences ``p_i - q_j`` are never formed: the method asks which is lowest along a direction, which is one
product with each set. It keeps few of them, at most one more than there are dimensions, whose combination is
the answer, and ends after finitely many steps.

References
----------
Wolfe, P. (1976). Finding the nearest point in a polytope. Mathematical Programming 11, 128-149.
https://doi.org/10.1007/BF01580381
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# Relative to the largest coordinate of the scene.
EXACT = 1e-15
LARGEST_COUNT = 200


class NearestPoint(NamedTuple):
    """``point`` = ``first`` - ``second``; ``short_by``: it is at most this much farther than the true one."""

    point: np.ndarray
    first: np.ndarray
    second: np.ndarray
    short_by: float


def nearest_difference(
    first: np.ndarray, second: np.ndarray, first_rays: np.ndarray | None = None, second_rays: np.ndarray | None = None
) -> NearestPoint:
    """Nearest point to the origin of ``conv(first) + cone(first_rays) - conv(second) - cone(second_rays)``.

    Parameters
    ----------
    first, second : (v, d) and (w, d) arrays
    first_rays, second_rays : (k, d) arrays, optional
    """
    dimension = first.shape[1]
    rays = _difference_rays(first_rays, second_rays, dimension)
    scale = max(float(np.abs(first).max()), float(np.abs(second).max())) or 1.0
    toward = first.mean(axis=0) - second.mean(axis=0)
    kept = [_lowest(first, second, toward)]
    columns = [first[kept[0][0]] - second[kept[0][1]]]
    weights = np.ones(1)
    point = columns[0]
    short_by = np.inf
    for _ in range(LARGEST_COUNT):
        norm = float(np.sqrt(point @ point))
        if norm <= EXACT * scale:
            short_by = norm
            break
        candidate = _lowest(first, second, point)
        difference = first[candidate[0]] - second[candidate[1]]
        short_by = norm - float(point @ difference) / norm
        if len(rays):
            slopes = rays @ point
            steepest = int(np.argmin(slopes))
            if slopes[steepest] < -1e-14 * norm:
                candidate, difference = (-1, steepest), rays[steepest] * scale
                short_by = np.inf
        if short_by <= EXACT * scale or candidate in kept:
            break
        grown = [*columns, difference], [*kept, candidate], np.append(weights, 0.0)
        columns, kept, weights = _best_combination(*grown)
        nearer = weights @ np.array(columns)
        if float(nearer @ nearer) >= float(point @ point):
            break  # no progress but rounding
        point = nearer
    on_first, on_second = np.zeros(dimension), np.zeros(dimension)
    for (i, j), weight in zip(kept, weights, strict=True):
        if i >= 0:
            on_first += weight * first[i]
            on_second += weight * second[j]
        elif first_rays is not None and j < len(first_rays):
            on_first += weight * scale * rays[j]
        else:
            on_second -= weight * scale * rays[j]
    return NearestPoint(on_first - on_second, on_first, on_second, max(short_by, 0.0))


def _difference_rays(first: np.ndarray | None, second: np.ndarray | None, dimension: int) -> np.ndarray:
    rays = [ray for ray in (first, None if second is None else -second) if ray is not None and len(ray)]
    return np.vstack(rays) if rays else np.zeros((0, dimension))


def _lowest(first: np.ndarray, second: np.ndarray, direction: np.ndarray) -> tuple[int, int]:
    return int((first @ direction).argmin()), int((second @ direction).argmax())


def _best_combination(
    columns: list[np.ndarray], kept: list[tuple[int, int]], weights: np.ndarray
) -> tuple[list[np.ndarray], list[tuple[int, int]], np.ndarray]:
    """Wolfe's minor cycle: nearest point of the affine hull; where that is outside, drop what is in the way."""
    while True:
        target = _affine_minimum(columns, kept)
        if target.min() > 0.0 or len(columns) == 1:
            return columns, kept, target
        falling = target <= 0.0
        drop = weights[falling] - target[falling]
        steps = np.where(drop > 0.0, weights[falling] / np.where(drop > 0.0, drop, 1.0), 0.0)
        step = min(1.0, float(steps.min()))
        weights = weights + step * (target - weights)
        gone = int(np.flatnonzero(falling)[int(np.argmin(steps))])
        if sum(i >= 0 for i, _ in kept) == 1 and kept[gone][0] >= 0:  # never all points: rays alone are no place
            gone = next(k for k in np.flatnonzero(falling) if kept[k][0] < 0)
        columns, kept = columns[:gone] + columns[gone + 1 :], kept[:gone] + kept[gone + 1 :]
        weights = np.clip(np.delete(weights, gone), 0.0, None)
        total = sum(weight for weight, (i, _) in zip(weights, kept, strict=True) if i >= 0)
        weights = np.array([w / total if i >= 0 else w for w, (i, _) in zip(weights, kept, strict=True)])


def _affine_minimum(columns: list[np.ndarray], kept: list[tuple[int, int]]) -> np.ndarray:
    """Weights of the point nearest to the origin; those of points sum to one, those of rays are free."""
    base = next(k for k, (i, _) in enumerate(kept) if i >= 0)
    others = [k for k in range(len(kept)) if k != base]
    weights = np.zeros(len(kept))
    if others:
        spans = np.array([columns[k] - columns[base] if kept[k][0] >= 0 else columns[k] for k in others])
        weights[others] = np.linalg.lstsq(spans.T, -columns[base], rcond=None)[0]
    weights[base] = 1.0 - sum(weights[k] for k in others if kept[k][0] >= 0)
    return weights
