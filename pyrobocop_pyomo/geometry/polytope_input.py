"""Checks of what a polytope is made from: lists of corners, and lists of half-spaces.

What changes nothing is left out: repeated points and points inside with a warning in the log.
"""

from __future__ import annotations

import logging
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.numerics.arrays import finite_numbers
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE

from .polyhedra import EmptyInterior, affine_basis, convex_hull, corners_of

logger = logging.getLogger(__name__)


def read_points(points: Any, name: str, label: str = "vertices") -> np.ndarray:
    """Finite points (v, 2 or 3) as an array of floats, or a ObstacleError that names the body."""
    array = finite_numbers(points, f"'{name}': {label}", ObstacleError)
    if array.ndim != 2 or array.shape[1] not in (2, 3):
        raise ObstacleError(
            f"'{name}': {label} have the shape {array.shape}; expected one row per point, with 2 or 3 coordinates."
        )
    return array


def corners_of_list(points: np.ndarray, *, allow_flat: bool, ordered: bool, name: str) -> np.ndarray:
    """The corners among the points; in the plane in counter-clockwise order.

    Parameters
    ----------
    ordered : bool
        Points in the plane are a polygon's outline: one that is not convex is refused.

    Raises
    ------
    ObstacleError
        For a flat shape that is not allowed to be one, and for an outline that is not convex.
    """
    distinct = _without_repeated(points, name)
    dimension = points.shape[1]
    basis = affine_basis(distinct, np.zeros((0, dimension)))
    if len(basis) < dimension and not allow_flat:
        spanned = ("a point", "a line", "a plane")[len(basis)]
        raise ObstacleError(
            f"'{name}': its {len(distinct)} distinct points lie in {spanned}; a body in {dimension} dimensions needs "
            f"{dimension + 1} points that do not. Add corners, or say allow_flat=True."
        )
    if len(basis) == 0:
        return distinct[:1]
    flat = len(basis) < dimension  # in its own plane then; else as it is, for the basis may mirror the order
    kept = convex_hull((distinct - distinct[0]) @ basis.T if flat else distinct).corners
    if dimension == 2 and len(basis) == 2 and ordered:
        _refuse_outlines_that_are_not_convex(distinct, name)
    if len(kept) < len(distinct) and ordered:
        logger.warning(
            "'%s': %d of its %d points are no corners of their convex hull and are left out.",
            name, len(distinct) - len(kept), len(distinct),
        )  # fmt: skip
    return distinct[kept]


def _without_repeated(points: np.ndarray, name: str) -> np.ndarray:
    closed = len(points) > 1 and np.array_equal(points[0], points[-1])
    if closed:  # a closed ring, as other programs write it: no warning
        points = points[:-1]
    tolerance = NEGLIGIBLE * float(np.ptp(points, axis=0).max())
    kept: list[int] = []
    for i, point in enumerate(points):
        if not kept or np.abs(points[kept] - point).max(axis=1).min() > tolerance:
            kept.append(i)
    if len(kept) < len(points):
        logger.warning("'%s': %d of its points are repeated and left out.", name, len(points) - len(kept))
    return points[kept]


def _refuse_outlines_that_are_not_convex(points: np.ndarray, name: str) -> None:
    """Around the outline, edges turn to one side only, and once in all; either side will do."""
    before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    crossed = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    angles = np.arctan2(crossed, (before * after).sum(axis=1))
    depths = (np.sign(angles.sum()) or 1.0) * crossed / np.linalg.norm(before + after, axis=1)
    row = int(np.argmin(depths))
    if depths[row] < -NEGLIGIBLE * np.ptp(points, axis=0).max() or abs(abs(angles.sum()) - 2.0 * np.pi) > 1.0:
        raise ObstacleError(
            f"'{name}': the outline is not convex, or crosses itself, at its point {row}, {points[row]}. List the "
            "points in order, cut the outline into convex parts with decompose(outline), or take the hull on purpose: "
            "Polytope.hull(points)."
        )


def corners_of_halfspaces(normals: Any, offsets: Any, *, bounded: bool, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Corners and rays of ``{y : normals @ y <= offsets}``.

    Raises
    ------
    ObstacleError
        For rows that are zero or not finite, a set that is empty or flat, and one without end if `bounded`.
    """
    rows = read_points(normals, name, "normals")
    sides = finite_numbers(offsets, f"'{name}': offsets", ObstacleError)
    if sides.shape != (len(rows),):
        raise ObstacleError(f"'{name}': {len(rows)} normals need as many offsets; given: {sides}.")
    lengths = np.linalg.norm(rows, axis=1)
    if len(rows) == 0 or lengths.min() == 0.0:
        where = f"row {int(np.argmin(lengths))} of the normals is zero" if len(rows) else "there are no rows"
        raise ObstacleError(f"'{name}': {where}, which is no half-space.")
    rows, sides = rows / lengths[:, None], sides / lengths
    try:
        corners, rays = corners_of(rows, sides)
    except EmptyInterior as error:
        what = "is empty" if error.radius < -NEGLIGIBLE else "has no interior"
        raise ObstacleError(
            f"'{name}': the set normals @ y <= offsets {what}. "
            "Normals point outwards, away from the body: check their signs."
        ) from None
    if bounded and len(rays):
        raise ObstacleError(
            f"'{name}': the set normals @ y <= offsets has no end in the direction {rays[0].round(6)}. "
            "Check that normals point outwards and that no side is missing; "
            "for a half-space or a wedge say bounded=False."
        )
    return corners, rays
