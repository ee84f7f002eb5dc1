"""Signed distance of two convex bodies, exact: how far apart they are, or how far one must move to be apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pyrobocop_pyomo.errors import GeometryError

from .minimum_norm import nearest_difference
from .polytope import Polytope
from .poses import Pose
from .separation import gap, separating_directions

# Relative to the scene. Closer than this, the difference of the nearest points is too short to give a direction,
# and the facets of the difference of the bodies give it.
TOUCHING = 1e-7


@dataclass(frozen=True)
class SignedDistance:
    """How two bodies lie to each other.

    Attributes
    ----------
    distance : float
        Positive: the distance. Negative: minus the length of the shortest translation that separates them.
    normal : (d,) array
        Unit vector from the second body to the first: the gap along it is the distance.
    first_point, second_point : (d,) arrays
        Where the distance is measured: ``first_point - second_point = distance * normal``.
    """

    distance: float
    normal: np.ndarray
    first_point: np.ndarray
    second_point: np.ndarray


def signed_distance(
    first: Polytope, second: Polytope, first_pose: Pose | None = None, second_pose: Pose | None = None
) -> SignedDistance:
    """Signed distance of two bodies at poses of numbers (of expressions: at their current values).

    Parameters
    ----------
    first, second : Polytope
        Both in the plane, or both in space.
    first_pose, second_pose : Pose, optional
        None: the body's frame is the world's.

    Raises
    ------
    GeometryError
        If one is in the plane and the other in space, or both extend without end such that no translation
        separates them.
    """
    if first.dimension != second.dimension:
        raise GeometryError(
            f"'{first.name}' has {first.dimension} dimensions and '{second.name}' {second.dimension}: they have no distance. "
            "Give both in the plane, or both in space."
        )
    if first_pose is not None:
        first = first.placed(first_pose)
    if second_pose is not None:
        second = second.placed(second_pose)
    core = distance_of_points(first.vertices, second.vertices, first.rays, second.rays)
    if core.distance == -np.inf:
        raise GeometryError(
            f"'{first.name}' and '{second.name}' overlap without end: no translation separates them. Bound one of them."
        )
    if first.radius == 0.0 and second.radius == 0.0:
        return core
    return SignedDistance(
        core.distance - first.radius - second.radius,
        core.normal,
        core.first_point - first.radius * core.normal,
        core.second_point + second.radius * core.normal,
    )


def distance_of_points(
    p: np.ndarray, q: np.ndarray, p_rays: np.ndarray | None = None, q_rays: np.ndarray | None = None
) -> SignedDistance:
    """Signed distance of the convex hulls of two point sets (with rays: of the unbounded sets); nothing is checked.

    Parameters
    ----------
    p, q : (v, d) and (w, d) arrays
        Corners in the world, in any order; d is 2 or 3.
    p_rays, q_rays : (k, d) arrays, optional
        Unit directions in which the sets have no end.

    Returns
    -------
    SignedDistance
        Of distance minus infinity if rays leave no direction to separate the sets along.
    """
    p_rays = p_rays if p_rays is not None and len(p_rays) else None
    q_rays = q_rays if q_rays is not None and len(q_rays) else None
    origin = 0.5 * (p.mean(axis=0) + q.mean(axis=0))  # scenes far from the world's origin lose no digits
    p, q = p - origin, q - origin
    scale = max(float(np.abs(p).max()), float(np.abs(q).max())) or 1.0
    nearest = nearest_difference(p, q, p_rays, q_rays)
    norm = float(np.sqrt(nearest.point @ nearest.point))
    if norm > TOUCHING * scale:
        normal = nearest.point / norm
        return SignedDistance(norm, normal, nearest.first + origin, nearest.second + origin)
    return _touching_or_overlapping(p, q, p_rays, q_rays, origin, scale)


def _touching_or_overlapping(
    p: np.ndarray, q: np.ndarray, p_rays: np.ndarray | None, q_rays: np.ndarray | None, origin: np.ndarray, scale: float
) -> SignedDistance:
    directions = separating_directions(p, q, p_rays, q_rays)
    if len(directions) == 0:
        nowhere = np.full(p.shape[1], np.nan)
        return SignedDistance(-np.inf, nowhere, nowhere, nowhere)
    gaps = np.array([gap(direction, p, q, p_rays, q_rays) for direction in directions])
    best = int(np.argmax(gaps))
    normal, distance = directions[best], float(gaps[best])
    on_second = _point_of_contact(p, q, p_rays, q_rays, normal, scale) + origin
    return SignedDistance(distance, normal, on_second + distance * normal, on_second)


def _point_of_contact(
    p: np.ndarray, q: np.ndarray, p_rays: np.ndarray | None, q_rays: np.ndarray | None, normal: np.ndarray, scale: float
) -> np.ndarray:
    """A point of q where p, moved along the normal until both touch, touches it."""
    along_p, along_q = p @ normal, q @ normal
    top = float(along_q.max())
    p_face = p[along_p <= along_p.min() + 1e-9 * scale]
    q_face = q[along_q >= top - 1e-9 * scale]
    flat = np.eye(len(normal)) - np.outer(normal, normal)
    p_flat = None if p_rays is None else p_rays[np.abs(p_rays @ normal) <= 1e-9] @ flat
    q_flat = None if q_rays is None else q_rays[np.abs(q_rays @ normal) <= 1e-9] @ flat
    return nearest_difference(p_face @ flat, q_face @ flat, p_flat, q_flat).second + top * normal
