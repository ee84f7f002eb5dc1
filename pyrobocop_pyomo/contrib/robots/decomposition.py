"""Convex parts of shapes that are not convex.

In the plane an outline with notches and holes is triangulated, and triangles are merged. In space the hull of a closed
triangle mesh is cut along the planes of the triangles inside, and cells are merged.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry.polyhedra import convex_hull
from pyrobocop_pyomo.geometry.polytope import Polytope
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.optional_imports import scipy, shapely

Part = TypeVar("Part")

LARGEST_NUMBER = 400


def decompose(shape: Any, *, name: str = "polytope") -> list[Polytope]:
    """Cut a shape into convex parts that fill it exactly and overlap in nothing but their boundaries.

    Parameters
    ----------
    shape : shapely polygon or multipolygon, (v, 2) array_like, or a mesh
        An outline, with holes if it is a polygon of Shapely's; or a closed triangle mesh: anything with
        ``vertices`` (v, 3) and ``faces`` (f, 3), such as one of trimesh's.
    name : str, optional
        Parts are called ``name[1]``, ``name[2]``, and so on; a single part is called ``name``.

    Returns
    -------
    list of Polytope
        In the plane few: a triangulation whose diagonals are taken out while what they separate stays convex,
        which leaves at most four times as many parts as needed. In space cells between the planes of the mesh.

    Raises
    ------
    ObstacleError
        If the outline crosses itself, the mesh is not closed, or it is so finely curved that there are too many parts.
    ModuleNotFoundError
        If Shapely is needed, for an outline, and not installed.

    References
    ----------
    Hertel, S., Mehlhorn, K. (1983). Fast triangulation of simple polygons. Foundations of Computation Theory,
    Lecture Notes in Computer Science 158, 207-218. https://doi.org/10.1007/3-540-12689-9_105
    """
    if hasattr(shape, "faces"):
        parts = convex_cells(np.asarray(shape.vertices, dtype=float), np.asarray(shape.faces, dtype=int), name)
    else:
        parts = [part for polygon in _polygons(shape, name) for part in _convex_polygons(polygon)]
    if len(parts) == 1:
        return [Polytope.hull(parts[0], name=name)]
    return [Polytope.hull(part, name=f"{name}[{k}]") for k, part in enumerate(parts, start=1)]


def _polygons(shape: Any, name: str) -> list[Any]:
    if not hasattr(shape, "geom_type"):
        points = np.asarray(shape, dtype=float)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
            raise ObstacleError(
                f"'{name}': an outline is a list of three or more points in the plane; given: shape {points.shape}. "
                "In space, give a mesh with vertices and faces."
            )
        shape = shapely.Polygon(points)
    if shape.geom_type not in ("Polygon", "MultiPolygon") or shape.is_empty:
        raise ObstacleError(f"'{name}': cannot cut a {shape.geom_type} into parts; give a polygon that is not empty.")
    if not shape.is_valid:
        raise ObstacleError(
            f"'{name}': the outline is none: {shapely.is_valid_reason(shape)}. List its points in order, once around; "
            "shapely.make_valid may repair it."
        )
    return list(getattr(shape, "geoms", [shape]))


def _convex_polygons(polygon: Any) -> list[np.ndarray]:
    """Corners (k, 2) of each part."""
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    return _merged([shapely.get_coordinates(triangle) for triangle in triangles], _hull_in_the_plane)


def _hull_in_the_plane(points: np.ndarray) -> tuple[np.ndarray, float]:
    hull = shapely.MultiPoint(points).convex_hull
    return shapely.get_coordinates(hull), hull.area


def convex_cells(vertices: np.ndarray, faces: np.ndarray, name: str) -> list[np.ndarray]:
    """Corners (k, 3) of convex cells whose union is the inside of a closed mesh.

    Raises
    ------
    ObstacleError
        If a side of a triangle does not belong to two, or more than some hundred cells would be needed.
    """
    _refuse_open_meshes(faces, name)
    extent = float(np.ptp(vertices, axis=0).max())
    triangles = vertices[faces]
    closed = [(vertices, triangles)]
    cells: list[np.ndarray] = []
    count = 0
    while closed:
        corners, near = closed.pop()
        count += 1
        if count > LARGEST_NUMBER:
            raise ObstacleError(
                f"'{name}': the mesh of {len(faces)} triangles needs more than {LARGEST_NUMBER // 2} convex "
                "cells. Simplify it, or cut it approximately with trimesh.decomposition.convex_decomposition, "
                "and give the parts."
            )
        hull = convex_hull(corners)
        corners = corners[hull.corners]
        near = near[_reach_inside(near, hull.normals, hull.offsets, NEGLIGIBLE * extent)]
        if len(near) == 0:
            if abs(_winding(triangles, corners.mean(axis=0))) > 0.5:
                cells.append(corners)
            continue
        # The plane of the largest triangle inside: fewer cuts than in the order of the file.
        areas = np.linalg.norm(np.cross(near[:, 1] - near[:, 0], near[:, 2] - near[:, 0]), axis=1)
        cutting = near[int(np.argmax(areas))]
        normal = np.cross(cutting[1] - cutting[0], cutting[2] - cutting[0]) / areas.max()
        for side in (normal, -normal):
            closed.append((_half(corners, side, float(side @ cutting[0]), NEGLIGIBLE * extent), near))
    return _merged(cells, _hull_in_space)


def _refuse_open_meshes(faces: np.ndarray, name: str) -> None:
    sides: dict[tuple[int, int], int] = {}
    for a, b, c in faces.tolist():
        for start, end in ((a, b), (b, c), (c, a)):
            key = (min(start, end), max(start, end))
            sides[key] = sides.get(key, 0) + (1 if start < end else -1)
    unmatched = [side for side, balance in sides.items() if balance != 0]
    if unmatched or not len(faces):
        raise ObstacleError(
            f"'{name}': the mesh is not closed: {len(unmatched)} of the sides of its {len(faces)} triangles have "
            f"no partner that runs the other way, such as the one between vertices {unmatched[:1]}. Merge vertices "
            "that are repeated, and fill its holes."
        )


def _reach_inside(triangles: np.ndarray, normals: np.ndarray, offsets: np.ndarray, tolerance: float) -> np.ndarray:
    """Which triangles have more than their boundary in the inside of a cell."""
    heights = triangles @ normals.T - offsets
    reaches = (heights.max(axis=2) < -tolerance).any(axis=1)  # a corner is inside
    possible = ~(heights.min(axis=1) >= -tolerance).any(axis=1)  # else all of it is behind one of the planes, or in it
    for k in np.flatnonzero(possible & ~reaches):
        reaches[k] = _is_cut_by_all(triangles[k], normals, offsets, tolerance)
    return reaches


def _is_cut_by_all(triangle: np.ndarray, normals: np.ndarray, offsets: np.ndarray, tolerance: float) -> bool:
    """Whether a part of a triangle is left after clipping it by all planes."""
    polygon = triangle
    for normal, offset in zip(normals, offsets, strict=True):
        heights = polygon @ normal - (offset - tolerance)
        kept = []
        for (a, b), (low, high) in zip(_pairs(polygon), _pairs(heights), strict=True):
            if low <= 0.0:
                kept.append(a)
            if (low < 0.0 < high) or (high < 0.0 < low):
                kept.append(a + low / (low - high) * (b - a))
        if len(kept) < 3:
            return False
        polygon = np.array(kept)
    area = np.linalg.norm(np.cross(polygon[1:-1] - polygon[0], polygon[2:] - polygon[0]).sum(axis=0))
    return bool(area > tolerance * tolerance)


def _pairs(rows: np.ndarray) -> zip:
    return zip(rows, np.roll(rows, -1, axis=0), strict=True)


def _half(corners: np.ndarray, normal: np.ndarray, offset: float, tolerance: float) -> np.ndarray:
    """Points whose hull is the part of a cell below a plane: corners below, and where sides cross the plane."""
    heights = corners @ normal - offset
    below, above = corners[heights <= tolerance], corners[heights > tolerance]
    low, high = heights[heights <= tolerance], heights[heights > tolerance]
    share = (low[:, None] / (low[:, None] - high[None, :]))[:, :, None]
    crossings = (below[:, None, :] + share * (above[None, :, :] - below[:, None, :]))[low < -tolerance]
    return np.vstack([below, crossings.reshape(-1, 3)])


def _winding(triangles: np.ndarray, point: np.ndarray) -> float:
    """How often the mesh goes around a point: the solid angle of its triangles, in full turns."""
    a, b, c = (triangles[:, k] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(edge, axis=1) for edge in (a, b, c))
    numerator = (a * np.cross(b, c)).sum(axis=1)
    denominator = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return float(np.arctan2(numerator, denominator).sum() / (2.0 * np.pi))


def _hull_in_space(points: np.ndarray) -> tuple[np.ndarray, float]:
    hull = scipy.spatial.ConvexHull(points)
    return points[hull.vertices], hull.volume


# -------------------------------------------------------------------------------------------------------------- joining


def _merged(cells: list[np.ndarray], hull_of: Callable[[np.ndarray], tuple[np.ndarray, float]]) -> list[np.ndarray]:
    """Put cells together while the hull of two holds no more than the two.

    Parameters
    ----------
    cells : list of (k, d) arrays
    hull_of : callable
        Corners and volume of a hull of points.
    """

    def join(one: tuple[np.ndarray, float], other: tuple[np.ndarray, float]) -> tuple[np.ndarray, float] | None:
        hull = hull_of(np.vstack([one[0], other[0]]))
        return hull if hull[1] <= (one[1] + other[1]) * (1.0 + NEGLIGIBLE) else None

    return [corners for corners, _ in joined(map(hull_of, cells), lambda cell: cell[0], 0.0, join)]


def joined(
    parts: Iterable[Part],
    points_of: Callable[[Part], np.ndarray],
    far: float,
    join: Callable[[Part, Part], Part | None],
) -> list[Part]:
    """Put one part in the place of two while that may be, those in the smallest box first.

    Parameters
    ----------
    parts : iterable
    points_of : callable
        Points (k, d) whose hull a part is.
    far : float
        Parts whose boxes are farther apart stay apart.
    join : callable
        Makes one part of two; None where they stay apart.
    """
    known: dict[int, Part] = {}
    boxes: list[tuple[np.ndarray, np.ndarray]] = []
    waiting: list[tuple[float, int, int]] = []

    def add(part: Part) -> None:
        points = points_of(part)
        low, high = points.min(axis=0), points.max(axis=0)
        for other in known:
            other_low, other_high = boxes[other]
            if (low <= other_high + far).all() and (other_low <= high + far).all():
                extent = float(np.linalg.norm(np.maximum(high, other_high) - np.minimum(low, other_low)))
                heapq.heappush(waiting, (extent, other, len(boxes)))
        known[len(boxes)] = part
        boxes.append((low, high))

    for part in parts:
        add(part)
    while waiting:
        _, i, j = heapq.heappop(waiting)
        made = join(known[i], known[j]) if i in known and j in known else None
        if made is not None:
            del known[i], known[j]
            add(made)
    return list(known.values())
