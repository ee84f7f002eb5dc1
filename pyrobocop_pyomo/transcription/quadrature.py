"""Integrals over the horizon by the quadrature of the scheme itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from pyomo.core.util import quicksum


def quadrature(integrand: Callable[[float], Any], weights: Mapping[float, Any]) -> Any:
    """``sum_t weights[t] * integrand(t)`` as a Pyomo expression (or a number).

    With the weights ``h_i b_k`` that the collocation equations imply, the value has the order of the scheme: it
    equals what an additional state ``xdot = integrand`` would have gained at the end.

    Parameters
    ----------
    integrand : callable
        Collocation point -> expression or number.
    weights : mapping of collocation point to number or expression
        ``Grid.quadrature_weights``, or expressions where element widths are variables.
    """
    return quicksum(weight * integrand(time) for time, weight in weights.items())
