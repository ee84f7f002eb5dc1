"""Convex polyhedra by corners and rays, and by half-spaces: hulls, and the conversion from one to the other.

Both conversions are one computation, by polarity. With the origin inside, the facets of ``{y : A y <= b}`` divided by
their offsets are points. The convex hull of these points has one facet per corner, and one facet through the origin
per ray. Directions in which a set extends both ways (a half-space, a slab) are split off first: the rest is pointed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.optional_imports import scipy

from .nearest_points import nearest_difference

# A set whose largest ball is smaller than this, relative to its extent, counts as flat.
THINNEST = 1e-8


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


def affine_rank(points: np.ndarray, rays: np.ndarray) -> int:
    """Dimension of the smallest plane that holds the points and, from them, the rays."""
    return len(affine_basis(points, rays))


def affine_basis(points: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Orthonormal rows (rank, dimension) that span the directions between the points, and the rays."""
    differences = points - points[0]  # exact where all are near: their mean would add a direction of rounding
    extent = np.abs(differences).max()
    # Rays have no length: each counts as much as the extent does.
    rows = np.vstack([differences / extent if extent > 0.0 else differences, rays])
    _, values, basis = np.linalg.svd(rows, full_matrices=False)
    return basis[: int((values > NEGLIGIBLE * np.sqrt(len(rows))).sum())]


def _distinct_planes(equations: np.ndarray) -> np.ndarray:
    kept: list[np.ndarray] = []
    remaining = equations
    while len(remaining):
        same = np.abs(remaining - remaining[0]).max(axis=1) <= NEGLIGIBLE
        kept.append(remaining[0])
        remaining = remaining[~same]
    return np.array(kept)


def halfspaces_of(vertices: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Facets ``A y <= b`` of the convex hull of corners and rays that span the space.

    Parameters
    ----------
    vertices : (v, dimension) array
    rays : (k, dimension) array
        Unit rows; may be empty.

    Returns
    -------
    (m, dimension) and (m,) arrays
        Unit rows, each of which is a facet.
    """
    if len(rays) == 0:
        hull = convex_hull(vertices)
        return hull.normals, hull.offsets
    basis = complement(_lines(rays), vertices.shape[1])
    if len(basis) == 0:  # the whole space
        return basis, np.zeros(0)
    corners, directions = vertices @ basis.T, rays @ basis.T
    directions = directions[np.linalg.norm(directions, axis=1) > NEGLIGIBLE]
    extent = max(float(np.ptp(corners, axis=0).max()), NEGLIGIBLE * float(np.abs(corners).max())) or 1.0
    inside = corners.mean(axis=0) + extent * directions.sum(axis=0)
    # The polar set {n : n.(v - inside) <= 1, n.r <= 0}: its corners, but the origin, are the facets.
    rows = np.vstack([(corners - inside) / extent, directions])
    polar, _ = corners_of(rows, np.concatenate([np.ones(len(corners)), np.zeros(len(directions))]))
    lengths = np.linalg.norm(polar, axis=1)
    normals = polar[lengths > NEGLIGIBLE] / lengths[lengths > NEGLIGIBLE][:, None] @ basis
    return normals, (normals @ vertices.T).max(axis=1)


def corners_of(normals: np.ndarray, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners and unit rays of ``{y : A y <= b}``, a set with an interior.

    Parameters
    ----------
    normals, offsets : (m, dimension) and (m,) arrays
        Any length of rows but zero.

    Returns
    -------
    (v, dimension) and (k, dimension) arrays
        A direction in which the set extends both ways is two rays; the corners are then corners of a section.

    Raises
    ------
    EmptyInterior
        If no ball fits inside.
    """
    lengths = np.linalg.norm(normals, axis=1)
    normals, offsets = normals / lengths[:, None], offsets / lengths
    basis = affine_basis(np.zeros((1, normals.shape[1])), normals)
    lines = complement(basis, normals.shape[1])
    rows = normals @ basis.T
    center, radius = largest_ball(rows, offsets)
    # Distances of the planes from the centre, in radii: at least one, so no division is close to zero.
    points = rows * (radius / (offsets - rows @ center))[:, None]
    hull = convex_hull(np.vstack([points, np.zeros(points.shape[1])]))
    finite = hull.offsets > NEGLIGIBLE
    corners = hull.normals[finite] * (radius / hull.offsets[finite])[:, None]
    if len(corners) > 1 and radius < THINNEST * float(np.ptp(corners, axis=0).max()):
        raise EmptyInterior(0.0)
    corners = center + _met_by_planes(corners, rows, offsets - rows @ center)
    # Adding zero makes minus zeros plain ones.
    return corners @ basis + 0.0, np.vstack([hull.normals[~finite] @ basis, lines, -lines]) + 0.0


def _met_by_planes(corners: np.ndarray, normals: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """The corners, relative to the centre, moved to where their planes meet: in thin sets, rounding shows."""
    extent = float(np.abs(corners).max())
    met = corners.copy()
    for k, corner in enumerate(corners):
        misses = offsets - normals @ corner
        through = np.abs(misses) <= NEGLIGIBLE * extent
        moved = corner + np.linalg.lstsq(normals[through], misses[through], rcond=None)[0]
        if np.abs(offsets[through] - normals[through] @ moved).max(initial=0.0) < np.abs(misses[through]).max(
            initial=0.0
        ):
            met[k] = moved
    return met


class EmptyInterior(ArithmeticError):
    """No ball fits between the planes; ``radius`` is the radius of the largest, relative (negative: empty)."""

    def __init__(self, radius: float) -> None:
        super().__init__(radius)
        self.radius = radius


def largest_ball(normals: np.ndarray, offsets: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre and radius of the largest ball inside (of a large one where there is no largest); unit rows."""
    dimension = normals.shape[1]
    whole = scale = float(np.abs(offsets).max()) or 1.0
    center = np.zeros(dimension)
    for _ in range(4):
        # Planes far away, cut short, only make the ball smaller; their numbers would drown the numbers of near ones.
        solution = scipy.optimize.linprog(
            np.append(np.zeros(dimension), -1.0),
            A_ub=np.column_stack([normals, np.ones(len(normals))]),
            b_ub=np.minimum((offsets - normals @ center) / scale, 1e3),
            bounds=[(None, None)] * dimension + [(None, 1.0)],
            method="highs",
        )
        if solution.x is None:
            break
        center = center + scale * solution.x[:-1]
        radius = float((offsets - normals @ center).min())
        if radius > 1e-4 * scale or scale < NEGLIGIBLE * whole:
            break
        # Small compared with the distance of the planes from the origin: again, from a point nearby.
        scale *= 1e-4
    if solution.x is None or radius <= 1e-3 * NEGLIGIBLE * whole:
        raise EmptyInterior(-np.inf if solution.x is None else radius / whole)
    return center, radius


def _lines(rays: np.ndarray) -> np.ndarray:
    """Orthonormal rows that span the directions in which the cone of the unit rays extends both ways."""
    # Not by scipy.optimize.nnls, which has been seen to return wrong weights with a residual of zero.
    origin = np.zeros((1, rays.shape[1]))
    both = np.array([nearest_difference(ray[None], origin, 1.0, rays).norm <= NEGLIGIBLE for ray in rays], dtype=bool)
    return affine_basis(np.zeros((1, rays.shape[1])), rays[both])


def complement(basis: np.ndarray, dimension: int) -> np.ndarray:
    """Orthonormal rows that span the orthogonal complement of orthonormal rows."""
    if len(basis) == 0:
        return np.eye(dimension)
    return np.linalg.svd(basis)[2][len(basis) :]
