"""Certificates in numbers: what the normal of one proves, recomputed without trusting a solver."""

from __future__ import annotations

import numpy as np

from pyrobocop_pyomo.optional_imports import scipy

from .formulations import PlacedSide
from .side_choice import gap_along

SHORTEST_NORMAL = 1e-9


def proven_gap(first: PlacedSide, second: PlacedSide, normal: np.ndarray) -> float:
    """Separation that a normal of any length proves; never more than the signed distance of the swept shapes.

    A normal that has collapsed to zero proves nothing, which is ``-inf``. Where shapes are unbounded, the normal is
    first moved to the nearest one along which both are bounded.
    """
    rays = np.vstack([second.rays, -first.rays])
    if len(rays):
        # What is left of a vector once its part in the cone of the rays is taken off points away from all of them.
        normal = normal - rays.T @ scipy.optimize.nnls(rays.T, normal)[0]
    length = float(np.linalg.norm(normal))
    if not length > SHORTEST_NORMAL:
        return -float("inf")
    return float(gap_along((normal / length)[None, :], first, second)[0])
