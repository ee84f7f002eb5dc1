"""Outlines of a shape for a small picture: a polygon in the plane, the facets of a body in space."""

from __future__ import annotations

from typing import Any

import numpy as np

# Towards the right and the back, as boxes are drawn by hand.
_VIEW = np.array([[1.0, 0.0], [0.45, 0.3], [0.0, 1.0]])
# More facets would be a black blot.
_MOST_FACETS = 60


def pictured_outlines(shape: Any) -> tuple[list[np.ndarray], list[float]]:
    """Polygons in the plane, and the radius by which each is padded.

    A shape with rays is drawn as far along them as it is wide.

    Parameters
    ----------
    shape : Polytope
    """
    corners = shape.vertices
    if len(shape.rays):
        length = 0.7 * max(float(np.ptp(corners, axis=0).max()), shape.radius, 1.0)
        corners = np.concatenate([corners, *(corners + length * ray for ray in shape.rays)])
    if shape.dimension == 2:
        return [_hull(corners)], [shape.radius]
    if shape.is_flat or len(shape.rays) or len(shape.halfspaces[0]) > _MOST_FACETS:
        return [_hull(corners @ _VIEW)], [shape.radius]
    size = max(float(np.ptp(corners, axis=0).max()), 1e-12)
    outlines = []
    for normal, offset in zip(*shape.halfspaces, strict=True):
        of_facet = corners[np.abs(corners @ normal - offset) < 1e-6 * size]
        if len(of_facet) > 2:
            outlines.append(_hull(of_facet @ _VIEW))
    return outlines, [shape.radius] * len(outlines)


def _hull(points: np.ndarray) -> np.ndarray:
    """Corners of the convex hull in order, by monotone chains; all points where there are fewer than three."""
    ordered = sorted(map(tuple, points.tolist()))
    if len(ordered) < 3:
        return np.array(ordered)
    chains = []
    for one_way in (ordered, ordered[::-1]):
        chain: list[tuple[float, ...]] = []
        for point in one_way:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= 0.0:
                chain.pop()
            chain.append(point)
        chains.append(chain[:-1])
    return np.array(chains[0] + chains[1])


def _turn(a: tuple[float, ...], b: tuple[float, ...], c: tuple[float, ...]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
