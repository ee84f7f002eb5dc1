"""Convex parts of shapes that are not convex: outlines with notches and holes in the plane, meshes in space."""

from __future__ import annotations

from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import GeometryError
from pyrobocop_pyomo.optional_imports import shapely

from .mesh_cells import convex_cells
from .polytope import Polytope

# Relative to the squared extent: an outline may turn by this much the wrong way and count as straight.
STRAIGHT = 1e-12


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
    GeometryError
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
            raise GeometryError(
                f"'{name}': an outline is a list of three or more points in the plane; given: shape {points.shape}. "
                "In space, give a mesh with vertices and faces."
            )
        shape = shapely.Polygon(points)
    if shape.geom_type not in ("Polygon", "MultiPolygon") or shape.is_empty:
        raise GeometryError(f"'{name}': cannot cut a {shape.geom_type} into parts; give a polygon that is not empty.")
    if not shape.is_valid:
        raise GeometryError(
            f"'{name}': the outline is none: {shapely.is_valid_reason(shape)}. List its points in order, once around; "
            "shapely.make_valid may repair it."
        )
    return list(getattr(shape, "geoms", [shape]))


def _convex_polygons(polygon: Any) -> list[np.ndarray]:
    """Corners (k, 2), counter-clockwise, of each part."""
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    rings = [shapely.get_coordinates(triangle)[:3] for triangle in triangles]
    corners, inverse = np.unique(np.vstack(rings), axis=0, return_inverse=True)
    tolerance = STRAIGHT * float(np.ptp(corners, axis=0).max()) ** 2
    parts: dict[int, list[int]] = {}
    for k, (ring, rows) in enumerate(zip(rings, inverse.reshape(-1, 3).tolist(), strict=True)):
        parts[k] = rows if _turn(*ring) > 0.0 else rows[::-1]
    # Long diagonals first: parts then are chunky rather than long.
    sides = {(a, b): k for k, rows in parts.items() for a, b in _around(rows)}
    diagonals = [(a, b) for a, b in sides if a < b and (b, a) in sides]
    for a, b in sorted(diagonals, key=lambda ends: -float(np.linalg.norm(corners[ends[0]] - corners[ends[1]]))):
        left, right = sides[a, b], sides[b, a]
        if left == right:
            continue
        merged = _without(parts[left], a, b) + _without(parts[right], b, a)
        if _is_convex(corners[merged], tolerance):
            parts[left] = merged
            for side in _around(parts.pop(right)):
                sides[side] = left
    return [corners[rows] for rows in parts.values()]


def _around(rows: list[int]) -> list[tuple[int, int]]:
    return list(zip(rows, [*rows[1:], rows[0]], strict=True))


def _without(rows: list[int], a: int, b: int) -> list[int]:
    """From b around to before a: the outline less its side from a to b, its last corner left to the neighbour."""
    start = rows.index(b)
    return [*rows[start:], *rows[:start]][:-1]


def _is_convex(ring: np.ndarray, tolerance: float) -> bool:
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    turns = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    if turns.min() < -tolerance:
        return False
    # All turns to the left, and only once around.
    angles = np.arctan2(turns, (before * after).sum(axis=1))
    return bool(angles.sum() < 3.0 * np.pi)


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
