"""Convex hulls of points in one, two or three dimensions: which points are corners, and the facets' planes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pyrobocop_pyomo.optional_imports import scipy

# Planes closer than this (unit normals, points scaled to extent one) are one facet that Qhull has cut in triangles.
SAME_PLANE = 1e-9


class Hull(NamedTuple):
    """Corners (indices; around in the plane), and facets ``normals @ y <= offsets`` with unit rows."""

    corners: np.ndarray
    normals: np.ndarray
    offsets: np.ndarray


def convex_hull(points: np.ndarray) -> Hull:
    """Hull of points that span their space.

    Parameters
    ----------
    points : (k, dimension) array
        Not all in one plane; `affine_rank` tells.
    """
    dimension = points.shape[1]
    if dimension == 1:
        low, high = int(np.argmin(points)), int(np.argmax(points))
        return Hull(np.array([low, high]), np.array([[-1.0], [1.0]]), np.array([-points[low, 0], points[high, 0]]))
    center = points.mean(axis=0)
    extent = np.abs(points - center).max()
    hull = scipy.spatial.ConvexHull((points - center) / extent)
    normals = _distinct_planes(hull.equations)[:, :-1]
    # Offsets afresh from all points: a merged facet's own plane may leave a corner outside by a rounding.
    return Hull(hull.vertices, normals, (points @ normals.T).max(axis=0))


def affine_rank(points: np.ndarray, rays: np.ndarray, tolerance: float = 1e-9) -> int:
    """Dimension of the smallest plane that holds the points and, from them, the rays."""
    return len(affine_basis(points, rays, tolerance))


def affine_basis(points: np.ndarray, rays: np.ndarray, tolerance: float = 1e-9) -> np.ndarray:
    """Orthonormal rows (rank, dimension) that span the directions between the points, and the rays."""
    differences = points - points.mean(axis=0)
    extent = np.abs(differences).max()
    # Rays have no length: each counts as much as the extent does.
    rows = np.vstack([differences / extent if extent > 0.0 else differences, rays])
    _, values, basis = np.linalg.svd(rows, full_matrices=False)
    return basis[: int((values > tolerance * np.sqrt(len(rows))).sum())]


def _distinct_planes(equations: np.ndarray) -> np.ndarray:
    kept: list[np.ndarray] = []
    remaining = equations
    while len(remaining):
        same = np.abs(remaining - remaining[0]).max(axis=1) <= SAME_PLANE
        kept.append(remaining[0])
        remaining = remaining[~same]
    return np.array(kept)
