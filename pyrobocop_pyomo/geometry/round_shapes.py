"""Corners of polytopes around cylinders, cones and ellipsoids, and by how much the polytopes are larger."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.numerics.rounding import ROUNDING
from pyrobocop_pyomo.optional_imports import scipy


def around_cone(radii: tuple[float, float], height: float, sides: int, name: str) -> tuple[np.ndarray, float]:
    """Corners (k, 3) of a frustum with flat sides around one with round ones, its base at z = 0, and the excess.

    Each side touches the round shape along a line. The corners of a regular polygon around a circle of radius r are at
    ``r / cos(pi / sides)`` from its centre.
    """
    base, top = radii
    if not all(math.isfinite(number) for number in (base, top, height)) or min(base, height) <= 0.0 or top < 0.0:
        raise ObstacleError(f"'{name}': radius {base}, top radius {top}, height {height}; expected positive lengths.")
    share = (1.0 + ROUNDING) / math.cos(math.pi / _checked_sides(sides, 3, name))
    angles = 2.0 * math.pi * np.arange(sides) / sides
    ring = share * np.column_stack([np.cos(angles), np.sin(angles)])
    levels = [np.column_stack([base * ring, np.zeros(sides)])]
    if top > 0.0:
        levels.append(np.column_stack([top * ring, np.full(sides, height)]))
    else:
        levels.append(np.array([[0.0, 0.0, height]]))
    return np.vstack(levels), max(base, top) * (share - 1.0)


def around_ellipsoid(semi_axes: Sequence[float], sides: int | None, name: str) -> tuple[np.ndarray, float]:
    """Corners (k, d) of a polytope around an ellipse or an ellipsoid, and the excess.

    It is the image of a polytope around the unit ball, whose corners are at most ``share`` from the centre. A corner
    ``share u`` goes to a point that is ``(share - 1) |A u|`` from the point ``A u`` of the ellipsoid.
    """
    lengths = np.array(semi_axes, dtype=float)
    if lengths.shape not in ((2,), (3,)) or not np.isfinite(lengths).all() or lengths.min() <= 0.0:
        raise ObstacleError(f"'{name}': semi-axes {semi_axes!r}; expected two or three positive lengths.")
    if len(lengths) == 2:
        count = _checked_sides(16 if sides is None else sides, 3, name)
        share = (1.0 + ROUNDING) / math.cos(math.pi / count)
        angles = 2.0 * math.pi * (np.arange(count) + 0.5) / count
        unit = np.column_stack([np.cos(angles), np.sin(angles)])
    else:
        unit = _on_sphere(-(-_checked_sides(10 if sides is None else sides, 5, name) // 5))
        share = (1.0 + ROUNDING) / float(-scipy.spatial.ConvexHull(unit).equations[:, -1].max())
    return share * unit * lengths, float((share - 1.0) * lengths.max())


def frame_along(axis: Sequence[float], name: str) -> np.ndarray:
    """A rotation (3, 3) that turns the z axis into a direction; the identity for the z axis itself."""
    vector = np.array(axis, dtype=float)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise ObstacleError(f"'{name}': its axis is {axis!r}; expected three numbers, not all zero.")
    z = vector / np.linalg.norm(vector)
    least = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.array([1.0, 0.0, 0.0]) if abs(z[2]) == 1.0 else np.cross(least, z)
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _checked_sides(sides: int, least: int, name: str) -> int:
    if not isinstance(sides, int) or sides < least:
        raise ObstacleError(f"'{name}': {sides!r} sides; expected a whole number, {least} or more.")
    return sides


def _on_sphere(parts: int) -> np.ndarray:
    """Points of an icosahedron whose edges are cut into so many parts, on the unit sphere: ``10 parts^2 + 2``."""
    golden = (1.0 + math.sqrt(5.0)) / 2.0
    signs = itertools.product((-1.0, 1.0), repeat=2)
    rows = [np.roll((0.0, a, b * golden), shift) for a, b in signs for shift in range(3)]
    corners = np.array(rows) / math.hypot(1.0, golden)
    triangles = corners[scipy.spatial.ConvexHull(corners).simplices]
    shares = [(i, j, parts - i - j) for i in range(parts + 1) for j in range(parts + 1 - i)]
    points = (np.array(shares, dtype=float) / parts @ triangles).reshape(-1, 3)
    points /= np.linalg.norm(points, axis=1)[:, None]
    return points[np.unique(points.round(9), axis=0, return_index=True)[1]]
