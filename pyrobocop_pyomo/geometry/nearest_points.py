"""The point nearest to the origin among the differences of two point sets: Wolfe's method, on supports only.

The differences ``p_i - q_j`` are never formed: the method asks which is lowest along a direction, which is one product
with each set. It keeps few of them, at most one more than there are dimensions, and the nearest point is a combination
of these. It ends after finitely many steps. A ray is kept like a point, but its weight is free.

One pair is solved with floats in lists, many pairs at once in whole arrays, the same steps for all. The inner problem,
the nearest point of an affine hull, is the same code for both.

References
----------
Wolfe, P. (1976). Finding the nearest point in a polytope. Mathematical Programming 11, 128-149.
https://doi.org/10.1007/BF01580381
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import mul
from typing import Any, NamedTuple

import numpy as np

# Relative to the scene, a little above rounding: smaller improvements cannot be distinguished.
EXACT = 1e-15
# Unit rays that point this little towards the origin are taken as level.
LEVEL = 1e-14
LARGEST_COUNT = 200
LARGEST_IDLE_COUNT = 10
# For many pairs at once, relative to the scene: closer bounds prove a distance, and what is accepted in the last step.
PROVEN = 1e-13
ACCEPTED = 1e-11
LARGEST_COUNT_AT_ONCE = 25

Coordinate = Any  # a float, or an array of as many as there are pairs
Vector = Any  # as many coordinates as there are dimensions: a list, or an array of rows


class Nearest(NamedTuple):
    """``point`` = ``first`` - ``second`` in the two sets, as near to the origin as rounding allows."""

    point: np.ndarray
    norm: float
    first: np.ndarray
    second: np.ndarray


class _Kept(NamedTuple):
    """A difference of two points (their rows), or a ray (row -1, and the ray's row)."""

    rows: tuple[int, int]
    at: list[float]

    @property
    def is_point(self) -> bool:
        return self.rows[0] >= 0


def difference_rays(first: np.ndarray | None, second: np.ndarray | None, dimension: int) -> np.ndarray:
    """Directions in which the differences of two sets have no end: rays of the first, and of the second reversed."""
    reversed_rays = None if second is None else -second
    return np.vstack([np.zeros((0, dimension)), *(of for of in (first, reversed_rays) if of is not None)])


def nearest_difference(
    first: np.ndarray, second: np.ndarray, scale: float, rays: np.ndarray, of_first: int = 0
) -> Nearest:
    """Nearest point to the origin of ``conv(first) - conv(second) + cone(rays)``.

    Parameters
    ----------
    first, second : (v, d) and (w, d) arrays
    scale : float
        Size of the coordinates: what zero is compared with.
    rays : (k, d) array
        Unit rows, see `difference_rays`.
    of_first : int, optional
        How many of the rays are the first set's.
    """
    direction = first.sum(axis=0) / len(first) - second.sum(axis=0) / len(second)
    kept = [_lowest(first, second, direction)]
    weights = [1.0]
    point = kept[0].at
    square = _dot(point, point)
    norm = square**0.5
    idle = 0
    idle_rays: list[int] = []
    for _ in range(LARGEST_COUNT):
        if norm <= EXACT * scale:
            break
        direction = np.array(point)
        lowest = _lowest(first, second, direction)
        short_by = norm - _dot(lowest.at, point) / norm
        if len(rays):
            slopes = rays @ direction
            # Rays that are kept are level but for rounding, as is one that has just been found to gain nothing.
            slopes[[j for i, j in (one.rows for one in kept) if i < 0] + idle_rays] = 0.0
            steepest = int(slopes.argmin())
            if slopes[steepest] < -LEVEL * norm:
                lowest, short_by = _Kept((-1, steepest), (rays[steepest] * scale).tolist()), norm
        if short_by <= EXACT * scale or any(lowest.rows == other.rows for other in kept):
            break
        kept, weights, nearer = _best_combination([*kept, lowest], [*weights, 0.0])
        square, before = _dot(nearer, nearer), square
        if square >= before:  # nothing gained but rounding, in length; the direction may still gain
            idle += 1
            if idle > LARGEST_IDLE_COUNT:
                break
            if not lowest.is_point:
                idle_rays.append(lowest.rows[1])
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
    return Nearest(np.array(point), norm, on_first, on_second)


def nearest_differences(
    first: np.ndarray,
    second: np.ndarray,
    scale: np.ndarray,
    least: np.ndarray,
    enough: np.ndarray | None = None,
) -> np.ndarray:
    """Nearest points to the origin of many differences of hulls at once, where they are proven to be apart.

    Parameters
    ----------
    first, second : (m, v, d) and (m, w, d) arrays
    scale : (m,) array
        Sizes of the coordinates.
    least : (m,) array
        Norms from which on sets count as apart.
    enough : (m,) array, optional
        Sets that are proven to be so far apart are not looked at any further; their differences are longer than the
        nearest ones then.

    Returns
    -------
    (m, d) array
        Rows of nan for sets that are not apart, and for the few that rounding keeps from ending. Use
        `nearest_difference` for these.
    """
    dimension = first.shape[2]
    nearest = np.full((len(first), dimension), np.nan)
    pairs = np.arange(len(first))
    point = _lowest_of_each(first, second, (first.mean(axis=1) - second.mean(axis=1)).T)
    # One place per difference that is kept; a free place has weight zero.
    kept, weights = np.zeros((dimension, *point.shape)), np.zeros((dimension, len(first)))
    kept[0], weights[0] = point, 1.0
    for count in range(LARGEST_COUNT_AT_ONCE):
        norm = np.sqrt(_dot(point, point))
        apart = norm > least
        lowest = _lowest_of_each(first, second, point)
        short_by = norm - _dot(lowest, point) / np.where(apart, norm, 1.0)
        proven = apart & (short_by <= (PROVEN if count < LARGEST_COUNT_AT_ONCE - 1 else ACCEPTED) * scale)
        if enough is not None:
            proven |= apart & (norm - short_by >= enough[pairs])
        nearest[pairs[proven]] = point[:, proven].T
        going = apart & ~proven
        if not going.any():
            break
        pairs, first, second, scale, least = (array[going] for array in (pairs, first, second, scale, least))
        kept, weights, point = _best_combinations(kept[:, :, going], weights[:, going], lowest[:, going])
    return nearest


def _lowest(first: np.ndarray, second: np.ndarray, direction: np.ndarray) -> _Kept:
    i, j = int((first @ direction).argmin()), int((second @ direction).argmax())
    return _Kept((i, j), (first[i] - second[j]).tolist())


def _lowest_of_each(first: np.ndarray, second: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """The lowest difference of each pair along its direction (d, m), itself (d, m)."""
    every, columns = np.arange(len(first)), directions.T[:, :, None]
    i = np.matmul(first, columns)[:, :, 0].argmin(axis=1)
    j = np.matmul(second, columns)[:, :, 0].argmax(axis=1)
    return np.ascontiguousarray((first[every, i] - second[every, j]).T)


def _best_combination(kept: list[_Kept], weights: list[float]) -> tuple[list[_Kept], list[float], list[float]]:
    """Wolfe's minor cycle: the affine hull's nearest point; where that is outside, drop the points that prevent it."""
    while True:
        base = next(k for k, one in enumerate(kept) if one.is_point)
        origin = kept[base].at
        others = [one for k, one in enumerate(kept) if k != base]
        spans = [[a - b for a, b in zip(o.at, origin, strict=True)] if o.is_point else o.at for o in others]
        target, point = _nearest_of_affine_hull(origin, spans)
        # Weights of points sum to one, weights of rays are free.
        target.insert(base, 1.0 - sum(weight for one, weight in zip(others, target, strict=True) if one.is_point))
        falling = [k for k, weight in enumerate(target) if weight <= 0.0]
        if not falling:
            return kept, target, point
        # The last point is never dropped: a combination of rays alone is a direction.
        if sum(one.is_point for one in kept) == 1:
            falling = [k for k in falling if not kept[k].is_point]
        steps = [weights[k] / max(weights[k] - target[k], 1e-300) for k in falling]
        step = min(steps)
        gone = falling[steps.index(step)]
        moved = [weight + step * (aim - weight) for weight, aim in zip(weights, target, strict=True)]
        weights = [max(weight, 0.0) for k, weight in enumerate(moved) if k != gone]
        kept = [one for k, one in enumerate(kept) if k != gone]


def _best_combinations(
    kept: np.ndarray, weights: np.ndarray, newest: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The minor cycle for each of many pairs; the newest point (d, m) is always kept, in a place that is free.

    Where that is impossible, since the origin is inside or by rounding, the point returned is zero.
    """
    count = newest.shape[1]
    nearest, share = np.zeros_like(newest), np.zeros(count)
    rows = np.arange(count)
    for _ in range(len(kept) + 1):
        base, old = newest[:, rows], weights[:, rows]
        spans = list(np.where(old[:, None] > 0.0, kept[:, :, rows] - base, 0.0))
        target, point = map(np.array, _nearest_of_affine_hull(base, spans))
        falling = (old > 0.0) & (target <= 0.0)
        rest = 1.0 - target.sum(axis=0)
        going = falling.any(axis=0)
        inside = ~going & (rest > 0.0)
        ended = rows[inside]
        weights[:, ended], share[ended], nearest[:, ended] = target[:, inside], rest[inside], point[:, inside]
        rows, old, target, falling = rows[going], old[:, going], target[:, going], falling[:, going]
        if not len(rows):
            break
        steps = np.where(falling, old / np.maximum(old - target, 1e-300), np.inf)
        moved = np.maximum(old + steps.min(axis=0) * (target - old), 0.0)
        moved[steps.argmin(axis=0), np.arange(len(rows))] = 0.0
        weights[:, rows] = moved
    place = weights.argmin(axis=0)
    nearest[:, weights.min(axis=0) > 0.0] = 0.0
    kept[place, :, np.arange(count)] = newest.T
    weights[place, np.arange(count)] = share
    return kept, weights, nearest


def _nearest_of_affine_hull(origin: Vector, spans: Sequence[Vector]) -> tuple[list[Coordinate], list[Coordinate]]:
    """Weights of the spans, and the point ``origin + weights @ spans`` nearest to zero: of one hull, or of many.

    By orthogonalisation, not normal equations, which would square the error where the hull is thin. A span that the
    others before it span gets no weight.
    """
    axes: list[Vector] = []
    triangle: list[list[Coordinate]] = []
    inverses: list[Coordinate] = []
    aims: list[Coordinate] = []
    point = list(origin)
    for span in spans:
        rest: Vector = span
        parts = []
        for axis in axes:
            part = _dot(axis, rest)
            rest = [r - part * a for r, a in zip(rest, axis, strict=True)]
            parts.append(part)
        inverse = _inverse(_dot(rest, rest) ** 0.5, 1e-15 * _dot(span, span) ** 0.5)
        axis = [r * inverse for r in rest]
        aim = -_dot(axis, point)
        point = [x + aim * a for x, a in zip(point, axis, strict=True)]
        axes.append(axis)
        triangle.append(parts)
        inverses.append(inverse)
        aims.append(aim)
    weights: list[Coordinate] = [0.0] * len(spans)
    for row in reversed(range(len(spans))):
        known = sum(triangle[column][row] * weights[column] for column in range(row + 1, len(spans)))
        weights[row] = (aims[row] - known) * inverses[row]
    return weights, point


def _inverse(size: Coordinate, floor: Coordinate) -> Coordinate:
    if isinstance(size, float):
        return 0.0 if size <= floor else 1.0 / size
    return np.where(size <= floor, 0.0, 1.0 / np.where(size <= floor, 1.0, size))


def _dot(a: Vector, b: Vector) -> Coordinate:
    return sum(map(mul, a, b))
