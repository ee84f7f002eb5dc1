"""Occupancy grids as convex shapes: every occupied cell lies within one of them."""

from __future__ import annotations

import heapq
import itertools
import logging
import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry.polyhedra import convex_hull
from pyrobocop_pyomo.geometry.polytope import Polytope
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.optional_imports import scipy

logger = logging.getLogger(__name__)

Part = TypeVar("Part")

# Of 0 to 100, or of 0 to 1: what the map server of ROS takes for occupied.
_OCCUPIED = 0.65


def cover_occupancy_grid(
    grid: Any,
    resolution: float,
    origin: Any = None,
    *,
    unknown: str = "occupied",
    tolerance: float | None = None,
    name: str = "map",
) -> list[Polytope]:
    """Cover the occupied cells of a grid by few convex shapes.

    Every occupied cell lies within one of the shapes, and no point of a shape is farther than the tolerance from an
    occupied cell.

    Parameters
    ----------
    grid : array_like, shape (rows, columns), or (cells along x, along y, along z)
        Booleans; whole numbers from 0 to 100 with -1 for unknown, as in ROS; whole numbers 0 and 1; or probabilities
        with NaN for unknown; 65 of 100 and 0.65 of 1 are occupied. In the plane x grows with the column and y with the
        row, as in ROS.
    resolution : float
        Length of the side of a cell.
    origin : (x, y), (x, y, yaw) or (x, y, z), optional
        Where the outer corner of the cell with least x and y (and z) is, as in ROS; zero by default. In the plane the
        grid may be turned by a yaw.
    unknown : str
        ``"occupied"`` or ``"free"``: what unknown cells count as.
    tolerance : float, optional
        In the plane, how far shapes may reach beyond occupied cells; one cell by default, which makes straight walls of
        stairs. With 0 the shapes are rectangles that fill the cells exactly, as in space always.
    name : str
        The shapes are called ``name[1]``, ``name[2]``, and so on.

    Returns
    -------
    list of Polytope
        They may overlap. The excess of each is its own largest distance from an occupied cell. None where nothing is
        occupied.

    Raises
    ------
    ObstacleError
        For values that are no occupancies, such as grey values of images, and for a wrong shape of the grid.
    """
    cells = _occupied_cells(grid, unknown, name)
    if not (isinstance(resolution, (int, float, np.number)) and math.isfinite(resolution) and resolution > 0.0):
        raise ObstacleError(f"'{name}': resolution {resolution!r}; expected the length of the side of a cell.")
    start, turn = _read_origin(origin, cells.ndim, name)
    reach = 1.0 if tolerance is None else float(tolerance) / float(resolution)
    if not (math.isfinite(reach) and reach >= 0.0):
        raise ObstacleError(f"'{name}': tolerance {tolerance!r}; expected a length that is not negative.")
    boxes = _boxes(cells)
    parts = [(_corners(low, high), 0.0) for low, high in boxes]
    if cells.ndim == 2 and reach > 0.0 and len(parts) > 1:
        distance = np.asarray(scipy.ndimage.distance_transform_edt(~cells))
        parts = _joined_boxes([corners for corners, _ in parts], distance, reach)
    logger.info("'%s': %d occupied cells are covered by %d shapes.", name, int(cells.sum()), len(parts))
    shapes = []
    for k, (corners, more) in enumerate(parts, start=1):
        label = name if len(parts) == 1 else f"{name}[{k}]"
        placed = start + float(resolution) * corners @ turn.T
        shapes.append(replace(Polytope.hull(placed, name=label), excess=more * float(resolution)))
    return shapes


def _occupied_cells(grid: Any, unknown: str, name: str) -> np.ndarray:
    """Which cells are occupied, indexed by x, y (and z)."""
    given = np.asarray(grid)
    if given.ndim not in (2, 3) or 0 in given.shape:
        remedy = " Reshape the data of a message: np.reshape(data, (height, width))." if given.ndim == 1 else ""
        raise ObstacleError(f"'{name}': a grid of shape {given.shape}; expected two or three dimensions.{remedy}")
    if unknown not in ("occupied", "free"):
        raise ObstacleError(f"'{name}': unknown={unknown!r}; expected 'occupied' or 'free'.")
    occupied = _occupied_values(given, unknown == "occupied", name)
    return occupied if given.ndim == 3 else np.ascontiguousarray(occupied.T)


def _occupied_values(given: np.ndarray, unknown: bool, name: str) -> np.ndarray:
    if given.dtype == bool:
        return given
    if not np.issubdtype(given.dtype, np.number) or np.iscomplexobj(given):
        raise ObstacleError(f"'{name}': cells of type {given.dtype}; expected booleans or numbers.")
    values = given.astype(float)
    if np.isinf(values).any():
        raise ObstacleError(f"'{name}': a cell is not finite. Mark unknown cells by NaN, or by -1.")
    not_known = np.isnan(values) | (values == -1.0)
    known = values[~not_known]
    largest = known.max(initial=0.0)
    if known.min(initial=0.0) < 0.0 or largest > 100.0 or (largest > 1.0 and (known != known.round()).any()):
        raise ObstacleError(
            f"'{name}': cells from {known.min():g} to {known.max():g}; expected booleans, 0 to 100 with -1 for "
            "unknown, or probabilities. Of a picture, whose first row is at the top and where dark is occupied, give "
            "the grid `picture[::-1] < 128`; of other values, `grid >= least`."
        )
    # Whole numbers 0 and 1 are a mask: one of a hundred would hardly be meant, and counts as occupied too.
    least = 100.0 * _OCCUPIED if largest > 1.0 else _OCCUPIED
    return np.where(not_known, unknown, np.nan_to_num(values) >= least)


def _read_origin(origin: Any, dimension: int, name: str) -> tuple[np.ndarray, np.ndarray]:
    numbers = np.zeros(dimension) if origin is None else np.array(origin, dtype=float)
    if numbers.shape not in ((dimension,), (3,)) or not np.isfinite(numbers).all():
        expected = "(x, y) or (x, y, yaw)" if dimension == 2 else "(x, y, z)"
        raise ObstacleError(f"'{name}': origin {origin!r}; expected {expected}.")
    if dimension == 3 or len(numbers) == 2:
        return numbers, np.eye(dimension)
    cosine, sine = math.cos(numbers[2]), math.sin(numbers[2])
    return numbers[:2], np.array([[cosine, -sine], [sine, cosine]])


# --------------------------------------------------------------------------------------------------------------- boxes


def _boxes(cells: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Boxes of occupied cells (lower, upper corner) that cover all of them; they may overlap.

    From a cell that is not covered, a box grows along one axis after the other, in every order of the axes. The one
    with most cells that are not covered yet is taken.
    """
    counts = np.zeros([size + 1 for size in cells.shape], dtype=np.int64)
    counts[(slice(1, None),) * cells.ndim] = cells
    for axis in range(cells.ndim):
        counts = counts.cumsum(axis=axis)
    remaining = cells.copy()
    orders = list(itertools.permutations(range(cells.ndim)))
    flat, first = remaining.ravel(), 0
    boxes: list[tuple[np.ndarray, np.ndarray]] = []
    while True:
        first += int(np.argmax(flat[first:]))
        if not flat[first]:
            return boxes
        seed = np.array(np.unravel_index(first, cells.shape))
        grown = [_grown(counts, seed, order) for order in orders]
        low, high = max(grown, key=lambda box: int(remaining[_region(*box)].sum()))
        remaining[_region(low, high)] = False
        boxes.append((low, high))


def _region(low: np.ndarray, high: np.ndarray) -> tuple[slice, ...]:
    return tuple(slice(a, b) for a, b in zip(low.tolist(), high.tolist(), strict=True))


def _grown(counts: np.ndarray, seed: np.ndarray, order: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    low, high = seed.copy(), seed + 1
    for axis in order:
        for end, step, most in ((high, 1, counts.shape[axis] - 1 - high[axis]), (low, -1, low[axis])):
            start = int(end[axis])
            near, far = 0, int(most)
            while near < far:  # a box that is full stays full when it shrinks: bisection
                middle = (near + far + 1) // 2
                end[axis] = start + step * middle
                near, far = (middle, far) if _is_full(counts, low, high) else (near, middle - 1)
            end[axis] = start + step * near
    return low, high


def _is_full(counts: np.ndarray, low: np.ndarray, high: np.ndarray) -> bool:
    total, volume = 0, 1
    ends = list(zip(low.tolist(), high.tolist(), strict=True))
    for chosen in itertools.product((0, 1), repeat=len(ends)):
        at = tuple(end[which] for end, which in zip(ends, chosen, strict=True))
        total += int(counts[at]) * (1 if (len(ends) - sum(chosen)) % 2 == 0 else -1)
    for a, b in ends:
        volume *= b - a
    return total == volume


def _corners(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    return np.array(list(itertools.product(*zip(low.tolist(), high.tolist(), strict=True))), dtype=float)


# -------------------------------------------------------------------------------------------------------------- joining


def joined(
    parts: Iterable[Part],
    cost: Callable[[Part, Part], float | None],
    join: Callable[[Part, Part], Part | None],
    holds: Callable[[Part, Part], bool] = lambda part, other: False,
) -> list[Part]:
    """Put one part in the place of two while that may be, the pair of least cost first.

    Parameters
    ----------
    parts : iterable
    cost : callable
        Of joining two parts; None for those that stay apart.
    join : callable
        Makes one part of two; None where they stay apart after all.
    holds : callable
        Whether a part that was made holds another one, which is left out then.
    """
    known = dict(enumerate(parts))
    waiting: list[tuple[float, int, int]] = []

    def propose(i: int, j: int) -> None:
        price = cost(known[i], known[j])
        if price is not None:
            heapq.heappush(waiting, (price, i, j))

    for i, j in itertools.combinations(known, 2):
        propose(i, j)
    number = len(known)
    while waiting:
        _, i, j = heapq.heappop(waiting)
        made = join(known[i], known[j]) if i in known and j in known else None
        if made is None:
            continue
        del known[i], known[j]
        known = {place: part for place, part in known.items() if not holds(made, part)}
        known[number] = made
        for other in [*known][:-1]:
            propose(other, number)
        number += 1
    return list(known.values())


def _joined_boxes(boxes: list[np.ndarray], distance: np.ndarray, reach: float) -> list[tuple[np.ndarray, float]]:
    """Hulls with their excess: of two, while it enters no free cell that is too far from the occupied ones.

    The point with a given place in its cell is as far from the point with the same place in the nearest occupied cell
    as the centres of both cells are: distances of centres bound those of all points.
    """
    near = reach + 1.0

    def join(one: tuple[np.ndarray, float], other: tuple[np.ndarray, float]) -> tuple[np.ndarray, float]:
        hull = _hull(np.vstack([one[0], other[0]]))
        return hull, _largest_distance(hull, distance)

    def cost(one: tuple[np.ndarray, float], other: tuple[np.ndarray, float]) -> float | None:
        (a, _), (b, _) = one, other
        if ((a.min(axis=0) > b.max(axis=0) + near) | (b.min(axis=0) > a.max(axis=0) + near)).any():
            return None
        hull, more = join(one, other)
        return _area(hull) - _area(a) - _area(b) if more <= reach else None

    return joined([(_hull(box), 0.0) for box in boxes], cost, join, lambda part, other: _is_within(other[0], part[0]))


def _hull(points: np.ndarray) -> np.ndarray:
    return points[convex_hull(points).corners]


def _area(corners: np.ndarray) -> float:
    x, y = corners.T
    return float(0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


def _sides(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Outward unit normals and offsets of the sides of a polygon with corners counter-clockwise."""
    along = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    return normals, (normals * corners).sum(axis=1)


def _is_within(inner: np.ndarray, outer: np.ndarray) -> bool:
    normals, offsets = _sides(outer)
    return bool((inner @ normals.T <= offsets + NEGLIGIBLE).all())


def _largest_distance(corners: np.ndarray, distance: np.ndarray) -> float:
    """Largest distance from an occupied cell among the cells that a polygon enters."""
    low = np.floor(corners.min(axis=0) + NEGLIGIBLE).astype(int)
    high = np.ceil(corners.max(axis=0) - NEGLIGIBLE).astype(int)
    x, y = (np.arange(a, b) + 0.5 for a, b in zip(low, high, strict=True))
    normals, offsets = _sides(corners)
    entered = np.ones((len(x), len(y)), dtype=bool)
    for (across, up), offset in zip(normals.tolist(), offsets.tolist(), strict=True):
        nearest = across * x[:, None] + up * y[None, :] - 0.5 * (abs(across) + abs(up))
        entered &= nearest < offset - NEGLIGIBLE
    return float(distance[low[0] : high[0], low[1] : high[1]][entered].max(initial=0.0))
