"""Integrals over the horizon by the quadrature of the scheme itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pyomo.core.util import quicksum

from pyrobocop_pyomo.numerics import Grid


def quadrature(integrand: Callable[[float], Any], grid: Grid, scale: Any = 1.0) -> Any:
    """``scale * sum_i h_i sum_k b_k integrand(t_{i,k})`` as a Pyomo expression (or a number).

    The weights are those that the collocation equations imply, so the value has the order of the
    scheme: it equals what an additional state ``xdot = integrand`` would have gained at the end.

    Parameters
    ----------
    integrand : callable
        Collocation point -> expression or number.
    grid : Grid
    scale : number or expression, optional
        Factor on every width: the duration variable where the grid is that of normalised time.
    """
    return scale * quicksum(weight * integrand(time) for time, weight in grid.quadrature_weights.items())
