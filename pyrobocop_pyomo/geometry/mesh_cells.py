"""Convex cells that fill a closed triangle mesh: its hull, cut along the planes of the triangles inside."""

from __future__ import annotations

import itertools

import numpy as np

from pyrobocop_pyomo.errors import GeometryError
from pyrobocop_pyomo.optional_imports import scipy

from .hulls import convex_hull

# Relative to the extent of the mesh.
ON_PLANE = 1e-9
LARGEST_NUMBER = 400


def convex_cells(vertices: np.ndarray, faces: np.ndarray, name: str) -> list[np.ndarray]:
    """Corners (k, 3) of convex cells whose union is the inside of a closed mesh.

    Raises
    ------
    GeometryError
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
            raise GeometryError(
                f"'{name}': the mesh of {len(faces)} triangles needs more than {LARGEST_NUMBER // 2} convex "
                "cells. Simplify it, or cut it approximately with trimesh.decomposition.convex_decomposition, "
                "and give the parts."
            )
        hull = convex_hull(corners)
        corners = corners[hull.corners]
        near = near[_reach_inside(near, hull.normals, hull.offsets, ON_PLANE * extent)]
        if len(near) == 0:
            if abs(_winding(triangles, corners.mean(axis=0))) > 0.5:
                cells.append(corners)
            continue
        # The plane of the largest triangle inside: fewer cuts than in the order of the file.
        areas = np.linalg.norm(np.cross(near[:, 1] - near[:, 0], near[:, 2] - near[:, 0]), axis=1)
        cutting = near[int(np.argmax(areas))]
        normal = np.cross(cutting[1] - cutting[0], cutting[2] - cutting[0]) / areas.max()
        for side in (normal, -normal):
            closed.append((_half(corners, side, float(side @ cutting[0]), ON_PLANE * extent), near))
    return _merged(cells)


def _refuse_open_meshes(faces: np.ndarray, name: str) -> None:
    sides: dict[tuple[int, int], int] = {}
    for a, b, c in faces.tolist():
        for start, end in ((a, b), (b, c), (c, a)):
            key = (min(start, end), max(start, end))
            sides[key] = sides.get(key, 0) + (1 if start < end else -1)
    unmatched = [side for side, balance in sides.items() if balance != 0]
    if unmatched or not len(faces):
        raise GeometryError(
            f"'{name}': the mesh is not closed: {len(unmatched)} of the sides of its {len(faces)} triangles have "
            f"no partner that runs the other way, such as the one between vertices {unmatched[:1]}. Merge vertices "
            "that are repeated, and fill its holes."
        )


def _reach_inside(triangles: np.ndarray, normals: np.ndarray, offsets: np.ndarray, tolerance: float) -> np.ndarray:
    """Which triangles have more than their boundary in the inside of a cell."""
    heights = triangles @ normals.T - offsets
    certain = (heights.max(axis=2) < -tolerance).any(axis=1)  # a corner is inside
    possible = ~(heights.min(axis=1) >= -tolerance).any(axis=1)  # else all of it is behind one of the planes, or in it
    for k in np.flatnonzero(possible & ~certain):
        certain[k] = _is_cut_by_all(triangles[k], normals, offsets, tolerance)
    return certain


def _is_cut_by_all(triangle: np.ndarray, normals: np.ndarray, offsets: np.ndarray, tolerance: float) -> bool:
    """Whether something is left of a triangle that each plane in turn cuts off."""
    piece = triangle
    for normal, offset in zip(normals, offsets, strict=True):
        heights = piece @ normal - (offset - tolerance)
        kept = []
        for (a, b), (low, high) in zip(_pairs(piece), _pairs(heights), strict=True):
            if low <= 0.0:
                kept.append(a)
            if (low < 0.0 < high) or (high < 0.0 < low):
                kept.append(a + low / (low - high) * (b - a))
        if len(kept) < 3:
            return False
        piece = np.array(kept)
    area = np.linalg.norm(np.cross(piece[1:-1] - piece[0], piece[2:] - piece[0]).sum(axis=0))
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


def _merged(cells: list[np.ndarray]) -> list[np.ndarray]:
    """Put cells together while the hull of two holds no more than the two."""
    volumes = [scipy.spatial.ConvexHull(cell).volume for cell in cells]
    changed = True
    while changed:
        changed = False
        for i, j in itertools.combinations(range(len(cells)), 2):
            both = np.vstack([cells[i], cells[j]])
            hull = scipy.spatial.ConvexHull(both)
            if hull.volume <= (volumes[i] + volumes[j]) * (1.0 + ON_PLANE):
                cells[i], volumes[i] = both[hull.vertices], hull.volume
                del cells[j], volumes[j]
                changed = True
                break
    return cells
