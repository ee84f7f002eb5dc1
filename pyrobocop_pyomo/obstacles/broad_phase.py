"""Which pairs are so far apart at the guess that they may be left out for now."""

from __future__ import annotations

import numpy as np

from pyrobocop_pyomo.geometry import distance_of_points

from .formulations import PlacedSide


def farther_apart(first: PlacedSide, second: PlacedSide, length: float) -> bool:
    """True when the convex hulls of all that two shapes sweep are farther apart than a length.

    Boxes around them decide most cases; the exact distance decides the rest.
    """
    radii = first.shape.radius + second.shape.radius
    unbounded = len(first.rays) or len(second.rays)
    if not unbounded and box_distance(first.vertices, second.vertices) - radii > length:
        return True
    near = distance_of_points(first.vertices, second.vertices, q_rays=second.rays, p_rays=first.rays)
    return bool(near.distance - radii > length)


def box_distance(first: np.ndarray, second: np.ndarray) -> float:
    """Distance between the boxes, parallel to the axes, around two sets of points (k, d)."""
    between = np.maximum(first.min(axis=0) - second.max(axis=0), second.min(axis=0) - first.max(axis=0))
    return float(np.linalg.norm(np.maximum(between, 0.0)))
