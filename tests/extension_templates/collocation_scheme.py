"""Template of a collocation scheme: choose the points, everything else follows."""

import numpy as np

from pyrobocop_pyomo.schemes import Scheme


def chebyshev(stages: int) -> Scheme:
    """Collocation at the roots of the Chebyshev polynomial of degree ``stages``, vectorised to (0, 1).

    Points strictly increase in (0, 1]. A last point of exactly 1.0 makes the scheme stiffly accurate: it then
    needs no continuity rows. Weights, order and derivative matrix are computed from the points.
    """
    k = np.arange(stages)
    roots = np.cos((2 * k + 1) * np.pi / (2 * stages))
    return Scheme.from_points(f"chebyshev({stages})", np.sort((1.0 + roots) / 2.0))
