"""What a list of half-spaces must be to bound a body."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import GeometryError

from .hulls import affine_rank
from .representations import EmptyInterior, corners_of
from .vertex_lists import read_points

logger = logging.getLogger(__name__)

# Corners closer than this to a plane, relative to the extent of the set, lie in it.
ON_PLANE = 1e-9


def corners_of_halfspaces(normals: Any, offsets: Any, *, bounded: bool, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Corners and rays of ``{y : normals @ y <= offsets}``; redundant rows are told in the log.

    Raises
    ------
    GeometryError
        For rows that are zero or not finite, a set that is empty or flat, and one without end if `bounded`.
    """
    rows = read_points(normals, name, "normals")
    try:
        sides = np.array(offsets, dtype=float)
    except (TypeError, ValueError) as error:
        raise GeometryError(f"'{name}': offsets are no list of numbers: {error}.") from None
    if sides.shape != (len(rows),) or not np.isfinite(sides).all():
        raise GeometryError(f"'{name}': {len(rows)} normals need as many finite offsets; given: {sides}.")
    lengths = np.linalg.norm(rows, axis=1)
    if len(rows) == 0 or lengths.min() == 0.0:
        where = f"row {int(np.argmin(lengths))} of the normals is zero" if len(rows) else "there are no rows"
        raise GeometryError(f"'{name}': {where}, which is no half-space.")
    rows, sides = rows / lengths[:, None], sides / lengths
    try:
        corners, rays = corners_of(rows, sides)
    except EmptyInterior as error:
        what = "is empty" if error.radius < -ON_PLANE else "has no interior"
        raise GeometryError(
            f"'{name}': the set normals @ y <= offsets {what}. "
            "Normals point outwards, away from the body: check their signs."
        ) from None
    if bounded and len(rays):
        raise GeometryError(
            f"'{name}': the set normals @ y <= offsets has no end in the direction {rays[0].round(6)}. "
            "Check that normals point outwards and that no side is missing; "
            "for a half-space or a wedge say bounded=False."
        )
    _tell_redundant_rows(rows, sides, corners, rays, name)
    return corners, rays


def _tell_redundant_rows(rows: np.ndarray, sides: np.ndarray, corners: np.ndarray, rays: np.ndarray, name: str) -> None:
    # Between the extent of the set and what rounding leaves of it, far from the origin.
    tolerance = ON_PLANE * float(np.ptp(corners, axis=0).max()) + 1e-14 * float(np.abs(sides).max())
    facets: list[int] = []
    for i, (row, side) in enumerate(zip(rows, sides, strict=True)):
        touching = corners[side - corners @ row <= tolerance]
        along = rays[np.abs(rays @ row) <= ON_PLANE]
        is_facet = len(touching) > 0 and affine_rank(touching, along) == rows.shape[1] - 1
        repeated = any(np.abs(rows[i] - rows[j]).max() <= ON_PLANE for j in facets)
        if is_facet and not repeated:
            facets.append(i)
    redundant = sorted(set(range(len(rows))) - set(facets))
    if redundant:
        logger.warning("'%s': half-spaces that cut nothing off are left out: rows %s.", name, redundant)
