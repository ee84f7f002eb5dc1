"""Directions that may separate two bodies, and how wide the gap along one is."""

from __future__ import annotations

import numpy as np

from .hulls import affine_basis, convex_hull
from .minimum_norm import _difference_rays
from .representations import _complement, halfspaces_of


def gap(
    normal: np.ndarray, p: np.ndarray, q: np.ndarray, p_rays: np.ndarray | None = None, q_rays: np.ndarray | None = None
) -> float:
    """Width of the gap from q to p along a normal: the least of p along it, less the most of q; minus infinity if none.

    Parameters
    ----------
    normal : (d,) array
        Points from q to p; of any length, and the gap is in multiples of it.
    p, q : (v, d) and (w, d) arrays
    p_rays, q_rays : (k, d) arrays, optional
    """
    rays = _difference_rays(p_rays, q_rays, len(normal))
    # Rays are unit vectors: what is below a rounding is along the gap, not across it.
    if len(rays) and float((rays @ normal).min()) < -1e-12 * float(np.linalg.norm(normal)):
        return -np.inf
    return float((p @ normal).min() - (q @ normal).max())


def separating_directions(
    p: np.ndarray, q: np.ndarray, p_rays: np.ndarray | None = None, q_rays: np.ndarray | None = None
) -> np.ndarray:
    """Unit normals, from q to p, of the facets of all differences p - q: the ways out of an overlap.

    Among them is the direction of the least translation that separates overlapping bodies. For differences that
    lie in one plane (two segments on a line) the normals of the plane are given.

    Returns
    -------
    (k, d) array
        Empty only where rays of both bodies leave no way out.
    """
    differences = (p[:, None, :] - q[None, :, :]).reshape(-1, p.shape[1])
    rays = _difference_rays(p_rays, q_rays, p.shape[1])
    basis = affine_basis(differences, rays)
    if len(basis) < p.shape[1]:
        normals = _complement(basis, p.shape[1])
        return np.vstack([normals, -normals])
    # The facets' outward normals point from the first to the second body's side: inwards is the way out.
    outward = halfspaces_of(differences, rays)[0] if len(rays) else convex_hull(differences).normals
    return -outward
