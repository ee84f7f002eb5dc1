"""Bounds on how high a convex shape is along a direction while its pose changes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.interval_arithmetic import Interval

from .distance import PointSets
from .polytope import Polytope, extents

_EPS = float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class PathBounds:
    """Bounds on the paths of a shape's corners over ``m`` subintervals ``[start, end]`` of local fractions.

    Attributes
    ----------
    shape : Polytope
    start, end : array, shape (m,)
    at_start, at_end : PointSets
    value, curvature : Interval of shape (m, d * d + d)
        Bounds of the entries of the pose, and of their second derivatives.
    """

    shape: Polytope
    start: Array
    end: Array
    at_start: PointSets
    at_end: PointSets
    value: Interval
    curvature: Interval

    def subset(self, chosen: Any) -> PathBounds:
        """Bounds on some of the subintervals."""
        start, end = self.at_start.subset(chosen), self.at_end.subset(chosen)
        times = self.start[chosen], self.end[chosen]
        return PathBounds(self.shape, *times, start, end, self.value[chosen], self.curvature[chosen])

    @property
    def deviation_factor(self) -> Array:
        """``(end - start)^2 / 8``: times a bound of the second derivative, it bounds the chord deviation."""
        return (self.end - self.start) ** 2 / 8.0

    def curvature_bounds(self, normals: Array) -> Interval:
        """Bounds of the second derivatives of ``n . p_i`` along directions (m, d), shape ``(m, v)``.

        Of ellipsoids they bound how far both heights, lowest and highest, deviate from their chords: the extent
        ``|B' n|`` is nowhere above its chord by more than the vector ``B' n`` is from its own, as a norm is convex.
        """
        return self._bounds_along(normals, self.curvature)

    def value_bounds(self, normals: Array) -> Interval:
        """Bounds of ``n . p`` along directions (m, d) for all points p of each corner, shape ``(m, v)``."""
        return self._bounds_along(normals, self.value)

    def _bounds_along(self, normals: Array, entries: Interval) -> Interval:
        """Bounds of ``n . p_i``, wider by the length of bounds of ``B' R' n`` where a corner is an ellipsoid."""
        bounds, ellipsoids = _along(normals, self.shape.vertices, entries, translates=True), self.shape.ellipsoids
        if ellipsoids is None:
            return bounds
        d = self.shape.dimension
        columns = _along(normals, ellipsoids.swapaxes(1, 2).reshape(-1, d), entries, translates=False)
        largest = np.maximum(np.abs(columns.low), np.abs(columns.high)).reshape(len(normals), -1, d)
        extent = np.linalg.norm(largest, axis=2) * (1.0 + 8 * _EPS)
        return Interval(bounds.low - extent, bounds.high + extent)

    def ray_bounds(self, normals: Array) -> Interval:
        """Bounds of ``n . ray`` along directions (m, d), shape ``(m, k)``."""
        curvature = _along(normals, self.shape.rays, self.curvature, translates=False)
        ends = [np.einsum("mr,mir->mi", normals, of.rays) for of in (self.at_start, self.at_end)]
        return _between(ends[0], ends[1], curvature, self.deviation_factor).intersect(
            _along(normals, self.shape.rays, self.value, translates=False)
        )

    def boxes(self) -> Interval:
        """Axis-aligned boxes that contain the shape during each subinterval, shape ``(m, d)``."""
        dimension, count = self.shape.dimension, len(self.start)
        along_axes = self.subset(np.repeat(np.arange(count), dimension))
        normals = np.tile(np.eye(dimension), (count, 1))
        starts, ends = heights(normals, along_axes.at_start), heights(normals, along_axes.at_end)
        curvature, value = along_axes.curvature_bounds(normals), along_axes.value_bounds(normals)
        lowest, highest = (
            _between(start, end, curvature, along_axes.deviation_factor).intersect(value)
            for start, end in zip(starts, ends, strict=True)
        )
        rays = along_axes.ray_bounds(normals)
        low = np.where((rays.low < 0.0).any(axis=1), -np.inf, lowest.low.min(axis=1)) - self.shape.radius
        high = np.where((rays.high > 0.0).any(axis=1), np.inf, highest.high.max(axis=1)) + self.shape.radius
        return Interval(low.reshape(count, dimension), high.reshape(count, dimension))


def heights(normals: Array, places: PointSets) -> tuple[Array, Array]:
    """How high the lowest and the highest point of each corner are along normals (m, d), shape ``(m, v)`` each."""
    middle = np.einsum("mr,mir->mi", normals, places.corners)
    extent = 0.0 if places.ellipsoids is None else extents(normals, places.ellipsoids)
    return middle - extent, middle + extent


def _between(start: Array, end: Array, curvature: Interval, factor: Array) -> Interval:
    """Bounds of functions with given ends and second derivatives: the chord, and the deviation on either side."""
    # Where the second derivative is not positive, the graph is nowhere below its chord. NaN stays NaN.
    below = factor[:, None] * np.maximum(curvature.high, 0.0)
    above = factor[:, None] * np.maximum(-curvature.low, 0.0)
    slack = 8 * _EPS * (np.abs(start) + np.abs(end))
    return Interval(np.minimum(start, end) - below - slack, np.maximum(start, end) + above + slack)


def _along(normals: Array, points: Array, entries: Interval, translates: bool) -> Interval:
    """Bounds of ``n . (R z + t)``, or of ``n . R z`` without translation, from bounds of ``R`` and ``t``."""
    count, d = normals.shape
    factors = np.einsum("mr,ic->mirc", normals, points).reshape(count, len(points), d * d)
    if translates:
        shifts = np.broadcast_to(normals[:, None, :], (count, len(points), d))
        factors = np.concatenate([factors, shifts], axis=2)
    entries = entries[:, None, : factors.shape[2]]
    # A factor of zero removes an entry also where its bounds are infinite: 0 * inf would be NaN.
    terms = [np.where(factors == 0.0, 0.0, factors * bound) for bound in (entries.low, entries.high)]
    slack = 4 * factors.shape[2] * _EPS * np.maximum(np.abs(terms[0]), np.abs(terms[1])).sum(axis=2)
    return Interval(
        np.minimum(terms[0], terms[1]).sum(axis=2) - slack, np.maximum(terms[0], terms[1]).sum(axis=2) + slack
    )
