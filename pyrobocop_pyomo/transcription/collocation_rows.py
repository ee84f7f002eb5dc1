"""The rows that make a polynomial follow a differential equation.

On element ``i`` with width ``h_i``, start value ``x_{i,0}`` and stage values ``x_{i,1..s}``::

    sum_{j=0..s} D[k, j] x_{i,j} - h_i f(t_{i,k}, ...) = 0          k = 1..s    (collocation)
    x_{i+1,0} - sum_{j=0..s} end_weights[j] x_{i,j}    = 0                      (continuity)

The second family exists only where the last stage is not the element end. This differential form holds
``f`` once per row; the integral form ``x_{i,k} = x_{i,0} + h_i sum_j A[k, j] f_j`` would hold it ``s`` times.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pyomo.core.expr import LinearExpression
from pyomo.core.expr.numeric_expr import MonomialTermExpression, SumExpression

from pyrobocop_pyomo.numerics import Grid


def collocation_rows(
    state: Mapping[float, Any], rate: Mapping[float, Any], grid: Grid, widths: list[Any]
) -> Iterator[tuple[float, Any]]:
    """Rows ``D x - h f = 0`` at each collocation point.

    Parameters
    ----------
    state : mapping of time to variable
        The state at every time of the grid.
    rate : mapping of collocation point to expression, variable or number
        The right-hand side, or a variable that stands for the derivative.
    grid : Grid
        ``N`` elements with ``s`` stages.
    widths : list, length N
        Width of each element: numbers, or expressions when the duration is a variable.

    Yields
    ------
    (time, row) : tuple
        The collocation point and ``(body, 0)``, the tuple form of an equality constraint.
    """
    coefficients = [row.tolist() for row in grid.scheme.D]
    for i, times in enumerate(grid.stage_times):
        variables = [state[grid.mesh.boundaries[i]], *(state[time] for time in times)]
        backward = -widths[i]
        for time, row in zip(times, coefficients, strict=True):
            # One flat sum, made from its terms, takes half the time of operators, to build and to walk over again.
            terms = map(MonomialTermExpression, zip(row, variables, strict=True))
            yield time, (SumExpression([*terms, backward * rate[time]]), 0)


def continuity_rows(state: Mapping[float, Any], grid: Grid) -> Iterator[tuple[float, Any]]:
    """Rows ``x_{i+1,0} = x_i(1)`` at each element end, for schemes whose last stage is not the end.

    Yields
    ------
    (time, row) : tuple
        The element end and ``(body, 0)``. Nothing for a stiffly accurate scheme.
    """
    if grid.scheme.stiffly_accurate:
        return
    coefficients = [-1.0, *grid.scheme.end_weights.tolist()]
    for i, times in enumerate(grid.stage_times):
        start, end = grid.mesh.boundaries[i : i + 2]
        variables = [state[end], state[start], *(state[time] for time in times)]
        yield end, (LinearExpression(linear_vars=variables, linear_coefs=coefficients), 0)
