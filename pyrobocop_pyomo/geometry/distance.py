"""Signed distance of two convex bodies, exact: how far apart they are, or how far one must move to be apart."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE

from .nearest_points import difference_rays, nearest_difference, nearest_differences
from .polyhedra import affine_basis, complement, convex_hull, halfspaces_of
from .polytope import Polytope, extents
from .poses import Pose

# Relative to the scene. Closer than this, the difference of the nearest points is too short to give a direction,
# and the facets of the difference of the bodies give it.
TOUCHING = 1e-7
# Rounding leaves touching bodies apart by less than this.
APART = 1e-14
# So many points of an ellipsoid's surface are taken, one after the other; some ten are enough but for thin ones.
LARGEST_COUNT_OF_POINTS = 30
# Where they overlap, depths are found to so much of the scene, and no less: each point takes another hull.
DEPTH = 1e-3
# Rays are unit vectors: one that points this little across a gap is along it.
LEVEL = 1e-8


@dataclass(frozen=True)
class SignedDistance:
    """Signed distance of two bodies, with its normal and its points.

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
    ObstacleError
        If one is in the plane and the other in space, or both extend without end such that no translation
        separates them.
    """
    if first.dimension != second.dimension:
        raise ObstacleError(
            f"'{first.name}' has {first.dimension} dimensions and '{second.name}' {second.dimension}. "
            "Give both in the plane, or both in space."
        )
    if first_pose is not None:
        first = first.placed(first_pose)
    if second_pose is not None:
        second = second.placed(second_pose)
    if first.ellipsoids is not None or second.ellipsoids is not None:
        return _distance_of_ellipsoids(first, second)
    core = distance_of_points(first.vertices, second.vertices, first.rays, second.rays)
    if core.distance == -np.inf:
        raise ObstacleError(
            f"'{first.name}' and '{second.name}' overlap without end: no translation separates them. Bound one of them."
        )
    return SignedDistance(
        core.distance - first.radius - second.radius,
        core.normal,
        core.first_point - first.radius * core.normal,
        core.second_point + second.radius * core.normal,
    )


def _distance_of_ellipsoids(first: Polytope, second: Polytope) -> SignedDistance:
    """Signed distance of two shapes one of which, at least, has ellipsoids."""
    (distance,), (normal,) = distances_of_shapes([(first, second)])
    origin = second.vertices[0]
    p, q = _highest_points(first, -normal) - origin, _highest_points(second, normal) - origin
    scale = max(float(np.abs(p).max()), float(np.abs(q).max())) or 1.0
    rays = difference_rays(first.rays, second.rays, first.dimension)
    # Moved apart along the normal, they are nearest where they are deepest in each other, or nearest, now.
    apart = p + ((q @ normal).max() - (p @ normal).min() + scale) * normal
    on_second = nearest_difference(apart, q, scale, rays, len(first.rays)).second + origin + second.radius * normal
    return SignedDistance(float(distance), normal, on_second + distance * normal, on_second)


def _highest_points(shape: Polytope, normal: np.ndarray) -> np.ndarray:
    """The highest point of each corner along a normal, without padding, shape (v, d)."""
    if shape.ellipsoids is None:
        return shape.vertices
    along = shape.ellipsoids.transpose(0, 2, 1) @ normal
    return shape.vertices + np.einsum("vdc,vc->vd", shape.ellipsoids, along) / np.linalg.norm(along, axis=1)[:, None]


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
    rays, of_first = difference_rays(p_rays, q_rays, p.shape[1]), 0 if p_rays is None else len(p_rays)
    origin = (p[0] + q[0]) * 0.5  # scenes far from the world's origin lose no digits
    p, q = p - origin, q - origin
    scale = max(float(np.abs(p).max()), float(np.abs(q).max())) or 1.0
    nearest = nearest_difference(p, q, scale, rays, of_first)
    if nearest.norm > TOUCHING * scale:
        normal = nearest.point / nearest.norm
        return SignedDistance(nearest.norm, normal, nearest.first + origin, nearest.second + origin)
    directions = separating_directions(p, q, rays)
    is_apart = nearest.norm > APART * scale
    if is_apart:
        directions = np.vstack([directions, nearest.point / nearest.norm])
    widths = _gaps(directions, p, q, rays)
    best = int(widths.argmax()) if len(widths) else -1
    if best < 0 or widths[best] == -np.inf:
        nowhere = np.full(p.shape[1], np.nan)
        return SignedDistance(-np.inf, nowhere, nowhere, nowhere)
    normal = directions[best]
    # Two corners this close give no normal that is accurate enough for its gap to be the distance; and a gap far below
    # zero says that rounding alone has kept bodies apart that overlap.
    is_apart = is_apart and bool(widths[-1] > -TOUCHING * scale)
    distance = max(nearest.norm if is_apart else -np.inf, float(widths[best]))
    on_second = _point_of_contact(p, q, rays, of_first, normal, scale) + origin
    return SignedDistance(distance, normal, on_second + distance * normal, on_second)


def distances_of_shapes(pairs: Sequence[tuple[Polytope, Polytope]]) -> tuple[np.ndarray, np.ndarray]:
    """Signed distances (k,) of pairs of shapes, padding included, and unit normals (k, d) from the second to the first.

    Shapes that overlap without end have the distance minus infinity.
    """
    distances, normals = np.empty(len(pairs)), np.empty((len(pairs), pairs[0][0].dimension if pairs else 0))
    alike: dict[tuple[Any, ...], list[int]] = defaultdict(list)
    for k, pair in enumerate(pairs):
        alike[tuple((len(of.vertices), len(of.rays), of.ellipsoids is None) for of in pair)].append(k)
    for members in alike.values():
        sets = [PointSets.of([pairs[k][place] for k in members]) for place in (0, 1)]
        exact, normals[members] = distances_of_points(*sets)
        distances[members] = exact - [pairs[k][0].radius + pairs[k][1].radius for k in members]
    return distances, normals


class PointSets(NamedTuple):
    """Corners of m shapes in the world, as many for each; their padding is not among them.

    Attributes
    ----------
    corners : (m, v, d) array
    rays : (m, k, d) array
        Unit rows.
    ellipsoids : (m, v, d, d) array or None
    """

    corners: np.ndarray
    rays: np.ndarray
    ellipsoids: np.ndarray | None = None

    @classmethod
    def of(cls, shapes: Sequence[Polytope]) -> PointSets:
        """The corners of shapes that are alike."""
        ellipsoids = [shape.ellipsoids for shape in shapes if shape.ellipsoids is not None]
        return cls(
            np.stack([shape.vertices for shape in shapes]),
            np.stack([shape.rays for shape in shapes]),
            np.stack(ellipsoids) if ellipsoids else None,
        )

    @classmethod
    def at(cls, shape: Polytope, rotations: np.ndarray, translations: np.ndarray) -> PointSets:
        """One shape at m poses, given by matrices (m, d, d) and vectors (m, d)."""
        turned = [np.einsum("mrc,ic->mir", rotations, vectors) for vectors in (shape.vertices, shape.rays)]
        ellipsoids = None if shape.ellipsoids is None else rotations[:, None] @ shape.ellipsoids
        return cls(turned[0] + translations[:, None, :], turned[1], ellipsoids)

    @property
    def lengths(self) -> np.ndarray:
        """No point of a corner is farther from the origin, (m, v)."""
        found = np.linalg.norm(self.corners, axis=2)
        return found if self.ellipsoids is None else found + np.linalg.norm(self.ellipsoids, axis=(2, 3))

    def subset(self, chosen: Any) -> PointSets:
        """Some of the shapes."""
        ellipsoids = None if self.ellipsoids is None else self.ellipsoids[chosen]
        return PointSets(self.corners[chosen], self.rays[chosen], ellipsoids)

    def joined(self, other: PointSets) -> PointSets:
        """Each shape with the corners and rays of another one."""
        ellipsoids = None
        if self.ellipsoids is not None and other.ellipsoids is not None:
            ellipsoids = np.concatenate([self.ellipsoids, other.ellipsoids], axis=1)
        corners, rays = (np.concatenate(of, axis=1) for of in zip(self[:2], other[:2], strict=True))
        return PointSets(corners, rays, ellipsoids)

    def moved(self, shifts: np.ndarray) -> PointSets:
        """Each shape moved by a vector, (m, d)."""
        return self._replace(corners=self.corners + shifts[:, None, :])


def distances_of_points(p: PointSets, q: PointSets) -> tuple[np.ndarray, np.ndarray]:
    """Signed distances of m pairs of convex hulls at once, see `distance_of_points`; nothing is checked.

    With rays, each pair is settled by itself.

    Returns
    -------
    distance : (m,) array
    normal : (m, d) array
        Unit vectors from the second to the first bodies, along which the gaps are the distances.

    Notes
    -----
    Of ellipsoids some points of their surfaces are taken, whose hulls are within the shapes. Beyond the gap along the
    normal of these hulls nothing is known to be, and its points are taken in addition: the distance of the hulls falls
    and the largest gap rises, until they are equal.
    """
    if p.ellipsoids is None and q.ellipsoids is None:
        return _distances_of_hulls(p, q)
    scale = np.abs(np.concatenate([p.corners, q.corners], axis=1) - q.corners[:, :1]).max(axis=(1, 2))
    for sets in (p, q):
        if sets.ellipsoids is not None:
            scale = scale + np.abs(sets.ellipsoids).max(axis=(1, 2, 3))
    gap, normal = np.full(len(p.corners), -np.inf), np.full(p.corners[:, 0].shape, np.nan)
    still_open, hulls = np.arange(len(gap)), (PointSets(p.corners, p.rays), PointSets(q.corners, q.rays))
    for _ in range(LARGEST_COUNT_OF_POINTS):
        of_hulls, directions = _distances_of_hulls(*hulls)
        lowest = _lowest_points(p, directions)
        highest = _lowest_points(q, -directions)
        found = np.einsum("md,md->m", lowest - highest, directions)
        better = found > gap[still_open]
        gap[still_open[better]], normal[still_open[better]] = found[better], directions[better]
        exact_enough = np.where(of_hulls > 0.0, NEGLIGIBLE, DEPTH) * scale[still_open]
        going = ~(of_hulls - gap[still_open] <= exact_enough)
        still_open = still_open[going]
        if not len(still_open):
            break
        p, q = p.subset(going), q.subset(going)
        hulls = _with_point(hulls[0], lowest, going), _with_point(hulls[1], highest, going)
    return gap, normal


def _with_point(hulls: PointSets, points: np.ndarray, chosen: np.ndarray) -> PointSets:
    return hulls.subset(chosen).joined(PointSets(points[chosen, None], hulls.rays[chosen, :0]))


def _distances_of_hulls(p: PointSets, q: PointSets) -> tuple[np.ndarray, np.ndarray]:
    """`distances_of_points` where corners are points."""
    distance, normal = np.full(len(p.corners), np.nan), np.full(p.corners[:, 0].shape, np.nan)
    if len(distance) and not (p.rays.shape[1] or q.rays.shape[1]):
        origin = 0.5 * (p.corners[:, :1] + q.corners[:, :1])
        near_p, near_q = p.corners - origin, q.corners - origin
        scale = np.maximum(np.abs(near_p).max(axis=(1, 2)), np.abs(near_q).max(axis=(1, 2)))
        nearest = nearest_differences(near_p, near_q, scale, TOUCHING * scale)
        distance = np.linalg.norm(nearest, axis=1)
        normal = nearest / distance[:, None]
    for k in np.flatnonzero(np.isnan(distance)):
        alone = distance_of_points(p.corners[k], q.corners[k], p.rays[k], q.rays[k])
        distance[k], normal[k] = alone.distance, alone.normal
    return distance, normal


def _lowest_points(sets: PointSets, normals: np.ndarray) -> np.ndarray:
    """Of each of m shapes the point (d,) that is lowest along its normal (m, d)."""
    every, heights = np.arange(len(normals)), np.einsum("md,mvd->mv", normals, sets.corners)
    if sets.ellipsoids is None:
        return np.asarray(sets.corners[every, heights.argmin(axis=1)])
    lengths = extents(normals, sets.ellipsoids)
    lowest = (heights - lengths).argmin(axis=1)
    chosen = sets.ellipsoids[every, lowest]
    along = np.einsum("mdc,mec,me->md", chosen, chosen, normals)
    return np.asarray(sets.corners[every, lowest] - along / lengths[every, lowest][:, None])


def _point_of_contact(
    p: np.ndarray, q: np.ndarray, rays: np.ndarray, of_first: int, normal: np.ndarray, scale: float
) -> np.ndarray:
    """A point of q that p touches when it is moved along the normal until both touch."""
    along_p, along_q = p @ normal, q @ normal
    top = float(along_q.max())
    p_face = p[along_p <= along_p.min() + LEVEL * scale]
    q_face = q[along_q >= top - LEVEL * scale]
    is_level = np.abs(rays @ normal) <= LEVEL
    if len(q_face) == 1 and not is_level[of_first:].any():
        return q_face[0]
    if len(p_face) == 1 and not is_level[:of_first].any():
        return p_face[0] + (top - float(p_face[0] @ normal)) * normal
    flat = np.eye(len(normal)) - np.outer(normal, normal)
    of_first = int(is_level[:of_first].sum())
    level = rays[is_level] @ flat
    return nearest_difference(p_face @ flat, q_face @ flat, scale, level, of_first).second + top * normal


def _gaps(normals: np.ndarray, p: np.ndarray, q: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Widths of the gaps (k,) along unit normals (k, d); `rays` are the rays of the differences."""
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
