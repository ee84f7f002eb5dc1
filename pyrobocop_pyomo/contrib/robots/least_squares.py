"""Many small least-squares problems with bounds, all at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE

# Step of difference quotients, relative to the size of a quantity.
DIFFERENCE = 1e-6


def damped_least_squares(residual: Callable[[Array], Array], start: Array, low: Array, high: Array) -> Array:
    """Minimise the squares of residuals in each row by damped Gauss-Newton steps, which end at the bounds.

    Parameters
    ----------
    residual : callable
        Of points (k, n), their residuals (k, m).
    start : (k, n) array
    low, high : (n,) arrays
        May be infinite.

    Returns
    -------
    (k, n) array
    """
    values = np.clip(start, low, high)
    count = values.shape[1]
    for _ in range(15):  # it converges in fewer, or not at all
        error = residual(values)
        columns = []
        for k in range(count):
            step = DIFFERENCE * np.maximum(1.0, np.abs(values[:, k]))
            moved = values.copy()
            moved[:, k] += step
            columns.append((residual(moved) - error) / step[:, None])
        slopes = np.stack(columns, axis=2)
        gradient = np.einsum("kij,ki->kj", slopes, error)
        square = np.einsum("kij,kil->kjl", slopes, slopes)
        weight = NEGLIGIBLE * (1.0 + np.einsum("kii->k", square))
        move = np.linalg.solve(square + weight[:, None, None] * np.eye(count), gradient[:, :, None])[:, :, 0]
        values = np.clip(values - move, low, high)
    return np.asarray(values, dtype=np.float64)
