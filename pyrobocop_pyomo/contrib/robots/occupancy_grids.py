"""Occupancy grids as convex shapes: every occupied cell lies within one of them."""

from __future__ import annotations

import itertools
import logging
import math
from bisect import bisect
from dataclasses import replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import planar_pose
from pyrobocop_pyomo.geometry.polyhedra import convex_hull
from pyrobocop_pyomo.geometry.polytope import Polytope
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.optional_imports import scipy

from .decomposition import joined

logger = logging.getLogger(__name__)

# Of 100: what the map server of ROS takes for occupied.
OCCUPIED = 65


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
        Booleans, or whole numbers from 0 to 100 with -1 for unknown, as in ROS; 65 is occupied. In the plane x grows
        with the column and y with the row, as in ROS.
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
    parts = [(corners, 0.0) for corners in _boxes(cells)]
    if cells.ndim == 2 and reach > 0.0 and len(parts) > 1:
        distance = np.asarray(scipy.ndimage.distance_transform_edt(~cells))
        parts = _joined_boxes(parts, distance, reach)
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
    occupied = given
    if given.dtype != bool:
        # Whole numbers 0 and 1 are rather a mask than one of a hundred.
        numbers = np.issubdtype(given.dtype, np.number) and not np.iscomplexobj(given)
        if not numbers or not np.isin(given, np.arange(-1, 101)).all() or given.max() == 1:
            raise ObstacleError(
                f"'{name}': expected booleans, or whole numbers from 0 to 100 with -1 for unknown. Of a picture, whose "
                "first row is at the top and where dark is occupied, give the grid `picture[::-1] < 128`; of other "
                "values, `grid >= least`."
            )
        occupied = np.where(given == -1, unknown == "occupied", given >= OCCUPIED)
    return occupied if given.ndim == 3 else np.ascontiguousarray(occupied.T)


def _read_origin(origin: Any, dimension: int, name: str) -> tuple[np.ndarray, np.ndarray]:
    numbers = np.zeros(dimension) if origin is None else np.array(origin, dtype=float)
    if numbers.shape not in ((dimension,), (3,)) or not np.isfinite(numbers).all():
        expected = "(x, y) or (x, y, yaw)" if dimension == 2 else "(x, y, z)"
        raise ObstacleError(f"'{name}': origin {origin!r}; expected {expected}.")
    if dimension == 3 or len(numbers) == 2:
        return numbers, np.eye(dimension)
    turn, start = planar_pose(*numbers.tolist()).numbers()
    return start, turn


# --------------------------------------------------------------------------------------------------------------- boxes


def _boxes(cells: np.ndarray) -> list[np.ndarray]:
    """Corners of boxes of occupied cells that cover all of them; they may overlap.

    From each cell that is not covered yet, a box grows along one axis after the other.
    """
    remaining = cells.copy()
    flat, first = remaining.ravel(), 0
    boxes: list[np.ndarray] = []
    while True:
        first += int(np.argmax(flat[first:]))
        if not flat[first]:
            return boxes
        seed = np.array(np.unravel_index(first, cells.shape)).tolist()
        box = [slice(place, place + 1) for place in seed]
        for axis, place in enumerate(seed):
            box[axis] = slice(None)
            is_full = np.asarray(cells[tuple(box)].all(axis=tuple(np.delete(range(cells.ndim), axis).tolist())))
            ends = [-1, *np.flatnonzero(~is_full).tolist(), len(is_full)]
            k = bisect(ends, place)
            box[axis] = slice(ends[k - 1] + 1, ends[k])
        remaining[tuple(box)] = False
        boxes.append(np.array(list(itertools.product(*((side.start, side.stop) for side in box))), dtype=float))


# -------------------------------------------------------------------------------------------------------------- joining


def _joined_boxes(
    boxes: list[tuple[np.ndarray, float]], distance: np.ndarray, reach: float
) -> list[tuple[np.ndarray, float]]:
    """Hulls with their excess: of two, while it enters no free cell that is too far from the occupied ones.

    The point with a given place in its cell is as far from the point with the same place in the nearest occupied cell
    as the centres of both cells are: distances of centres bound the distances of all points.
    """

    def join(one: tuple[np.ndarray, float], other: tuple[np.ndarray, float]) -> tuple[np.ndarray, float] | None:
        made = _hull_with_excess(np.vstack([one[0], other[0]]), distance)
        return made if made[1] <= reach else None

    return joined(boxes, lambda part: part[0], reach + 1.0, join)


def _hull_with_excess(points: np.ndarray, distance: np.ndarray) -> tuple[np.ndarray, float]:
    """Corners of a hull, and the largest distance from an occupied cell among the cells that it enters."""
    hull = convex_hull(points)
    low = np.floor(points.min(axis=0) + NEGLIGIBLE).astype(int)
    high = np.ceil(points.max(axis=0) - NEGLIGIBLE).astype(int)
    x, y = (np.arange(a, b) + 0.5 for a, b in zip(low, high, strict=True))
    entered = np.ones((len(x), len(y)), dtype=bool)
    for (across, up), offset in zip(hull.normals.tolist(), hull.offsets.tolist(), strict=True):
        nearest = across * x[:, None] + up * y[None, :] - 0.5 * (abs(across) + abs(up))
        entered &= nearest < offset - NEGLIGIBLE
    excess = float(distance[low[0] : high[0], low[1] : high[1]][entered].max(initial=0.0))
    return points[hull.corners], excess
