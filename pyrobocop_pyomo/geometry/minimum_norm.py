"""The point nearest to the origin among the differences of two point sets: Wolfe's method, on supports only.

The differences ``p_i - q_j`` are never formed: the method asks which is lowest along a direction, which is one
product with each set. It keeps few of them, at most one more than there are dimensions, whose combination is
the answer, and ends after finitely many steps. A ray is kept like a point, but its weight is free.

References
----------
Wolfe, P. (1976). Finding the nearest point in a polytope. Mathematical Programming 11, 128-149.
https://doi.org/10.1007/BF01580381
"""

from __future__ import annotations

from operator import mul
from typing import NamedTuple

import numpy as np

# Relative to the scene, a little above rounding: nothing nearer than this can be told from what was found.
EXACT = 1e-15
# Unit rays that point this little towards the origin are taken as level.
LEVEL = 1e-14
LARGEST_COUNT = 200
LARGEST_IDLE_COUNT = 10


class Nearest(NamedTuple):
    """``point`` = ``first`` - ``second`` in the two sets; at most ``short_by`` farther away than the nearest."""

    point: np.ndarray
    norm: float
    first: np.ndarray
    second: np.ndarray
    short_by: float


class _Kept(NamedTuple):
    """A difference of two points (their rows), or a ray (row -1, and the ray's row)."""

    rows: tuple[int, int]
    at: list[float]

    @property
    def is_point(self) -> bool:
        return self.rows[0] >= 0


def difference_rays(first: np.ndarray | None, second: np.ndarray | None, dimension: int) -> np.ndarray:
    """Directions in which the differences of two sets have no end: rays of the first, and of the second reversed."""
    rays = [np.zeros((0, dimension))]
    if first is not None:
        rays.append(first)
    if second is not None:
        rays.append(-second)
    return np.vstack(rays)


def nearest_difference(
    first: np.ndarray, second: np.ndarray, scale: float, rays: np.ndarray | None = None, of_first: int = 0
) -> Nearest:
    """Nearest point to the origin of ``conv(first) - conv(second) + cone(rays)``.

    Parameters
    ----------
    first, second : (v, d) and (w, d) arrays
    scale : float
        Size of the coordinates: what zero is compared with.
    rays : (k, d) array, optional
        Unit rows, see `difference_rays`.
    of_first : int, optional
        How many of the rays are the first set's.
    """
    direction = first.sum(axis=0) / len(first) - second.sum(axis=0) / len(second)
    kept = [_lowest(first, second, direction)]
    weights = [1.0]
    point = kept[0].at
    square = _dot(point, point)
    short_by = norm = square**0.5
    idle = 0
    idle_rays: list[int] = []
    for _ in range(LARGEST_COUNT):
        if norm <= EXACT * scale:
            short_by = norm
            break
        direction = np.array(point)
        found = _lowest(first, second, direction)
        short_by = norm - _dot(found.at, point) / norm
        if rays is not None and len(rays):
            slopes = rays @ direction
            # Rays that are kept are level but for rounding, as is one that has just been found to gain nothing.
            slopes[[j for i, j in (one.rows for one in kept) if i < 0] + idle_rays] = 0.0
            steepest = int(slopes.argmin())
            if slopes[steepest] < -LEVEL * norm:
                found, short_by = _Kept((-1, steepest), (rays[steepest] * scale).tolist()), norm
        if short_by <= EXACT * scale or any(found.rows == other.rows for other in kept):
            break
        kept, weights, nearer = _best_combination([*kept, found], [*weights, 0.0])
        square, before = _dot(nearer, nearer), square
        if square >= before:  # nothing gained but rounding, in length; the direction may still gain
            idle += 1
            if idle > LARGEST_IDLE_COUNT:
                break
            if not found.is_point:
                idle_rays.append(found.rows[1])
        else:
            idle_rays.clear()
        point, norm = nearer, square**0.5
    on_first, on_second = np.zeros(first.shape[1]), np.zeros(first.shape[1])
    for one, weight in zip(kept, weights, strict=True):
        i, j = one.rows
        if i >= 0:
            on_first += weight * first[i]
            on_second += weight * second[j]
        elif j < of_first:
            on_first += weight * np.array(one.at)
        else:
            on_second -= weight * np.array(one.at)
    return Nearest(np.array(point), norm, on_first, on_second, max(short_by, 0.0))


def _lowest(first: np.ndarray, second: np.ndarray, direction: np.ndarray) -> _Kept:
    i, j = int((first @ direction).argmin()), int((second @ direction).argmax())
    return _Kept((i, j), (first[i] - second[j]).tolist())


def _best_combination(kept: list[_Kept], weights: list[float]) -> tuple[list[_Kept], list[float], list[float]]:
    """Wolfe's minor cycle: the affine hull's nearest point; where that is outside, drop what is in the way."""
    while True:
        target, point = _affine_minimum(kept)
        falling = [k for k, weight in enumerate(target) if weight <= 0.0]
        if not falling:
            return kept, target, point
        # The last point is never dropped: rays alone are no place.
        if sum(one.is_point for one in kept) == 1:
            falling = [k for k in falling if not kept[k].is_point]
        steps = [weights[k] / max(weights[k] - target[k], 1e-300) for k in falling]
        step = min(steps)
        gone = falling[steps.index(step)]
        moved = [weight + step * (aim - weight) for weight, aim in zip(weights, target, strict=True)]
        weights = [max(weight, 0.0) for k, weight in enumerate(moved) if k != gone]
        kept = [one for k, one in enumerate(kept) if k != gone]


def _affine_minimum(kept: list[_Kept]) -> tuple[list[float], list[float]]:
    """Weights of the affine hull's nearest point and the point; weights of points sum to one, of rays are free.

    By orthogonalisation, not normal equations, which would square the error where the hull is thin.
    """
    base = next(k for k, one in enumerate(kept) if one.is_point)
    origin = kept[base].at
    others = [k for k in range(len(kept)) if k != base]
    axes: list[list[float]] = []
    triangle: list[list[float]] = []
    aims: list[float] = []
    point = origin
    for k in others:
        at = kept[k].at
        rest = span = [a - b for a, b in zip(at, origin, strict=True)] if kept[k].is_point else at
        parts = []
        for axis in axes:
            part = _dot(axis, rest)
            rest = [r - part * a for r, a in zip(rest, axis, strict=True)]
            parts.append(part)
        size = _dot(rest, rest) ** 0.5
        if size <= 1e-15 * _dot(span, span) ** 0.5:
            axis = [0.0] * len(rest)  # spanned by the others: no weight
        else:
            axis = [r / size for r in rest]
        aim = -_dot(axis, point)
        point = [x + aim * a for x, a in zip(point, axis, strict=True)]
        axes.append(axis)
        triangle.append([*parts, size])
        aims.append(aim)
    weights = [0.0] * len(kept)
    for row in reversed(range(len(others))):
        known = sum(triangle[column][row] * weights[others[column]] for column in range(row + 1, len(others)))
        size = triangle[row][row]
        weights[others[row]] = (aims[row] - known) / size if any(axes[row]) else 0.0
    weights[base] = 1.0 - sum(weights[k] for k in others if kept[k].is_point)
    return weights, point


def _dot(a: list[float], b: list[float]) -> float:
    return sum(map(mul, a, b))
