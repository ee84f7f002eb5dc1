"""Outlines of convex shapes in the plane and their faces in space; padded, and cut off where they are unbounded."""

from __future__ import annotations

from typing import Any

import numpy as np

from pyrobocop_pyomo.geometry.polyhedra import EmptyInterior, affine_basis, affine_rank, convex_hull, corners_of
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE

_CORNERS_OF_A_CIRCLE = 48


def outline(shape: Any, view: Array | None = None) -> Array:
    """Corners of a shape in the plane, counter-clockwise.

    Parameters
    ----------
    shape : Polytope
        Of dimension two; read are its corners, with their ellipsoids, its rays and its radius.
    view : array, shape (2, 2), optional
        Lower and upper corner of what is seen; the outline of a shape with rays ends a little outside of it, those of
        others are left whole.

    Returns
    -------
    array, shape (k, 2)
        Three corners or more; two for a segment and one for a point without padding; none for what lies wholly
        outside the view.
    """
    points = _within(shape, view)
    return convex_outline(points) if len(points) else points


def faces(shape: Any, view: Array | None = None) -> list[Array]:
    """Polygons that bound a shape in space.

    Parameters
    ----------
    shape : Polytope
        Of dimension three.
    view : array, shape (2, 3), optional
        Lower and upper corner of what is seen; what is outside is cut off, since axes in space hide nothing.

    Returns
    -------
    list of arrays, shape (k, 3)
        Corners of each face in order. A flat shape has one face, a segment one of two corners, a point one of one.
    """
    points = _within(shape, view)
    return convex_faces(points) if len(points) else []


def _within(shape: Any, view: Array | None) -> Array:
    """Points whose hull is what is seen of a shape; in the plane a bounded one is left whole, and flat ones are."""
    points = padded(np.asarray(shape.images(_unit_ball(shape.dimension)), dtype=float), float(shape.radius))
    frame = _frame(view, points) if view is None or shape.dimension == 2 else np.asarray(view, dtype=float)
    if shape.is_bounded:
        is_inside = np.all(frame[0] <= points.min(axis=0)) and np.all(points.max(axis=0) <= frame[1])
        if shape.dimension == 2 or view is None or is_inside or affine_rank(points, shape.rays) < 3:
            return points
        _, normals, offsets = convex_hull(points)
    else:
        normals, offsets = shape.halfspaces[0], shape.halfspaces[1] + shape.radius
    sides = np.eye(shape.dimension)
    try:
        return corners_of(np.vstack([normals, sides, -sides]), np.concatenate([offsets, frame[1], -frame[0]]))[0]
    except EmptyInterior:  # it is out of sight
        return points[:0]


def convex_outline(points: Array) -> Array:
    """Corners of the convex hull of points that lie in one plane, in order; counter-clockwise where that is all space.

    Of points on a line the two ends, of one point itself.
    """
    basis = affine_basis(points, np.zeros((0, points.shape[1])))
    if not len(basis):
        return points[:1]
    flat = len(basis) < points.shape[1]  # as it is elsewhere, for the basis may mirror the order
    return np.asarray(points[convex_hull(points @ basis.T if flat else points).corners])


def convex_faces(points: Array) -> list[Array]:
    """Faces of the convex hull of points in space, each as its corners in order; flat sets are one face."""
    if affine_rank(points, np.zeros((0, 3))) < 3:
        return [convex_outline(points)]
    hull = convex_hull(points)
    near = NEGLIGIBLE * float(np.ptp(points, axis=0).max())
    depths = hull.offsets - points @ hull.normals.T
    return [convex_outline(points[depth <= near]) for depth in depths.T]


def padded(points: Array, radius: float) -> Array:
    """Points whose hull is that of the given points with a margin; the points themselves without one."""
    if not radius:
        return points
    return (points[:, None, :] + radius * _unit_ball(points.shape[1])).reshape(-1, points.shape[1])


def _unit_ball(dimension: int) -> Array:
    """Points (k, d) of the unit circle or the unit sphere."""
    angle = np.linspace(0, 2 * np.pi, _CORNERS_OF_A_CIRCLE, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    if dimension == 2:
        return circle
    height = np.linspace(-np.pi / 2, np.pi / 2, 9)[:, None, None]
    few = circle[::3]
    ring = np.concatenate([np.cos(height) * few, np.broadcast_to(np.sin(height), (9, len(few), 1))], axis=-1)
    return ring.reshape(-1, 3)


def _frame(view: Array | None, points: Array) -> Array:
    """The view with a margin, so that the cut itself is not seen; without a view, the surroundings of the corners."""
    if view is None:
        size = max(float(np.ptp(points, axis=0).max()), 1.0)
        view = np.array([points.min(axis=0) - size, points.max(axis=0) + size])
    margin = 0.02 * (view[1] - view[0]).max()
    return np.array([view[0] - margin, view[1] + margin])
