"""Point clouds as convex shapes: every point lies within one of them."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry.polyhedra import affine_basis, convex_hull
from pyrobocop_pyomo.geometry.polytope import Polytope
from pyrobocop_pyomo.geometry.polytope_input import read_points
from pyrobocop_pyomo.optional_imports import scipy

from .decomposition import joined

# Samples of a boundary are so dense that it is nowhere farther from the points than at a sample plus this share.
_BETWEEN_SAMPLES = 0.25


def cover_point_cloud(points: Any, tolerance: float, *, radius: float = 0.0, name: str = "cloud") -> list[Polytope]:
    """Cover points by few convex shapes.

    Every point lies within one of the shapes. The boundary of each shape (a flat one is all boundary) is nowhere
    farther than the tolerance from one of the points; what a boundary encloses is filled.

    Parameters
    ----------
    points : array_like, shape (N, 2) or (N, 3)
    tolerance : float
        More than the distance between neighbouring points of one surface: gaps up to twice as wide are closed, wider
        ones stay open.
    radius : float
        Each point stands for all that is closer to it than this: noise, or half the distance between points.
    name : str
        The shapes are called ``name[1]``, ``name[2]``, and so on.

    Returns
    -------
    list of Polytope
        They may overlap, and may be flat: points of a straight wall in the plane give a segment, padded by the radius.

    Raises
    ------
    ObstacleError
        For points that are no list of finite numbers, and lengths that are not positive.
    """
    cloud = read_points(points, name, "points")
    if len(cloud) == 0:
        return []
    if not (math.isfinite(tolerance) and tolerance > 0.0):
        raise ObstacleError(f"'{name}': tolerance {tolerance!r}; expected a positive length.")
    cloud = np.unique(cloud, axis=0)
    cover = _Cover(cloud, float(tolerance))
    # Neighbours are joined while the hull of both is near enough.
    parts = joined(cover.split(), lambda part: cloud[part], 2.0 * float(tolerance), cover.join)
    labels = [name] if len(parts) == 1 else [f"{name}[{k}]" for k in range(1, len(parts) + 1)]
    return [
        Polytope.hull(cloud[part], radius=radius, allow_flat=True, name=label)
        for part, label in zip(parts, labels, strict=True)
    ]


class _Cover:
    """Sets of points (indices) whose hulls stay near the points."""

    def __init__(self, cloud: np.ndarray, tolerance: float) -> None:
        self.cloud, self.tolerance = cloud, tolerance
        self.tree = scipy.spatial.cKDTree(cloud)

    def split(self) -> list[np.ndarray]:
        """Halve the cloud across its longest direction until every hull is near enough."""
        done, waiting = [], [np.arange(len(self.cloud))]
        while waiting:
            part = waiting.pop()
            if len(part) == 1 or self._is_near(self.cloud[part]):
                done.append(part)
                continue
            points = self.cloud[part]
            centred = points - points.mean(axis=0)
            along = centred @ np.linalg.svd(centred.T @ centred)[0][:, 0]
            order = np.argsort(along, kind="stable")
            gaps = np.diff(along[order])
            widest = int(np.argmax(gaps))
            # Where nothing is between two groups, they belong apart.
            cut = widest + 1 if gaps[widest] > self.tolerance else len(part) // 2
            waiting += [part[order[:cut]], part[order[cut:]]]
        return done

    def join(self, one: np.ndarray, other: np.ndarray) -> np.ndarray | None:
        """Two sets as one; None where its hull would not be near enough."""
        both = np.concatenate([one, other])
        return both if self._is_near(self.cloud[both]) else None

    def _is_near(self, points: np.ndarray) -> bool:
        """Whether the boundary of the hull is nowhere farther than the tolerance from a point of the cloud."""
        step = _BETWEEN_SAMPLES * self.tolerance
        samples = (_samples(simplex, step) for simplex in _boundary(points))
        return all(self.tree.query(each)[0].max() <= self.tolerance - step for each in samples)


def _boundary(points: np.ndarray) -> list[np.ndarray]:
    """Segments in the plane, triangles in space, whose union is the boundary of a hull; a flat hull is all boundary."""
    dimension = points.shape[1]
    basis = affine_basis(points, np.zeros((0, dimension)))
    flat = (points - points[0]) @ basis.T
    if len(basis) <= 1:
        along = flat[:, 0] if len(basis) else np.zeros(len(points))
        return [points[[int(np.argmin(along)), int(np.argmax(along))]]]
    if len(basis) < dimension:
        corners = points[convex_hull(flat).corners]
        return [corners[[0, k, k + 1]] for k in range(1, len(corners) - 1)]
    centre = points.mean(axis=0)
    hull = scipy.spatial.ConvexHull(points - centre)
    return [points[simplex] for simplex in hull.simplices]


def _samples(simplex: np.ndarray, step: float) -> np.ndarray:
    """Points of a segment or a triangle, none of whose points is farther than a step from the next of them."""
    longest = max(float(np.linalg.norm(a - b)) for a, b in itertools.combinations(simplex, 2))
    # The circumradius of a cell with sides up to `longest / parts` is less than its longest side.
    parts = max(1, math.ceil(longest / step))
    if len(simplex) == 2:
        shares = np.linspace(0.0, 1.0, parts + 1)
        return simplex[0] + shares[:, None] * (simplex[1] - simplex[0])
    i, j = np.array([(i, j) for i in range(parts + 1) for j in range(parts + 1 - i)]).T / parts
    return simplex[0] + i[:, None] * (simplex[1] - simplex[0]) + j[:, None] * (simplex[2] - simplex[0])
