"""Directions that may separate two bodies, and the width of the gap along them."""

from __future__ import annotations

import contextlib
from functools import lru_cache

import numpy as np

from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.optional_imports import scipy

from .nearest_points import difference_rays
from .polyhedra import affine_basis, complement, convex_hull, halfspaces_of

# Rays are unit vectors: one that points this little across a gap is along it.
LEVEL = 1e-8


def gaps(normals: np.ndarray, p: np.ndarray, q: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Widths of the gaps (k,) along unit normals (k, d); `rays` are those of the differences."""
    widths = (p @ normals.T).min(axis=0) - (q @ normals.T).max(axis=0)
    if len(rays):
        widths[(rays @ normals.T).min(axis=0) < -LEVEL] = -np.inf
    return widths


def separating_directions(
    p: np.ndarray, q: np.ndarray, p_rays: np.ndarray | None = None, q_rays: np.ndarray | None = None
) -> np.ndarray:
    """Unit normals, from q to p, of the facets of all differences p - q: the ways out of an overlap.

    Among them is the direction of the least translation that separates overlapping bodies. For differences that
    lie in one plane (two segments on a line) the normals of the plane are given.

    Parameters
    ----------
    p, q : (v, d) and (w, d) arrays
    p_rays, q_rays : (k, d) arrays, optional
        Unit rows.

    Returns
    -------
    (k, d) array
        Empty only where rays of both bodies leave no way out.
    """
    differences = (p[:, None, :] - q[None, :, :]).reshape(-1, p.shape[1])
    rays = difference_rays(p_rays, q_rays, p.shape[1])
    basis = affine_basis(differences, rays)
    if len(basis) < p.shape[1]:
        normals = complement(basis, p.shape[1])
        return np.vstack([normals, -normals])
    # Outward normals of the differences point from p to q.
    return -(halfspaces_of(differences, rays)[0] if len(rays) else convex_hull(differences).normals)


def candidate_normals(p: np.ndarray, q: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """The directions of `separating_directions`, found faster, with repetitions and some that are not needed.

    A facet of the differences is spanned by edges of p and of q and by rays. Where these are few, all that any
    two of them span are taken, and no hull is needed; else Qhull's facets, triangle by triangle.
    """
    dimension = p.shape[1]
    if max(len(p), len(q)) <= (8 if dimension == 2 or len(rays) else 2):
        normals = _spanned(np.vstack([_edges(p), _edges(q), rays]))
        if len(normals):
            return np.vstack([normals, -normals])
    elif len(rays) == 0:
        differences = (p[:, None, :] - q[None, :, :]).reshape(-1, dimension)
        with contextlib.suppress(scipy.spatial.QhullError):  # they lie in one plane
            return -scipy.spatial.ConvexHull(differences).equations[:, :-1]
    return separating_directions(p, q, rays)


def _edges(points: np.ndarray) -> np.ndarray:
    """Unit vectors between all pairs of points: few of them are edges, and all edges are among them."""
    i, j = _pairs(len(points))
    vectors = points[i] - points[j]
    lengths = np.linalg.norm(vectors, axis=1)
    kept = lengths > NEGLIGIBLE * (lengths.max() if len(lengths) else 0.0)
    return vectors[kept] / lengths[kept, None]


def _spanned(vectors: np.ndarray) -> np.ndarray:
    """Unit normals, one of each two opposite ones, of all planes (lines in 2-D) that the unit vectors span."""
    if vectors.shape[1] == 2:
        return np.column_stack([-vectors[:, 1], vectors[:, 0]])
    i, j = _pairs(len(vectors))
    normals = np.cross(vectors[i], vectors[j])
    lengths = np.linalg.norm(normals, axis=1)
    kept = lengths > NEGLIGIBLE
    return normals[kept] / lengths[kept, None]


@lru_cache(maxsize=64)
def _pairs(count: int) -> tuple[np.ndarray, np.ndarray]:
    return np.triu_indices(count, 1)
