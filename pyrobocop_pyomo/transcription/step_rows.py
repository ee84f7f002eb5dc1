"""The rows that carry a state from one element boundary to the next by a map, without a derivative."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pyrobocop_pyomo.numerics import Grid, Scheme


def can_step(scheme: Scheme) -> bool:
    """True when an element is one step: one stage, and a state at its start and at its end only.

    Implicit and explicit Euler are such schemes. The stage of a Gauss scheme lies inside the element, where a map from
    one boundary to the next says nothing.
    """
    return scheme.stages == 1 and scheme.end_is_a_node


def step_rows(
    state: Mapping[float, Any], following: Mapping[float, Any], grid: Grid
) -> Iterator[tuple[float, tuple[Any, int]]]:
    """Rows ``x_{i+1} - g_i = 0``, one per element.

    Parameters
    ----------
    state : mapping of time to variable
        The state at every time of the grid.
    following : mapping of collocation point to expression or number
        What the state is at the end of the element that the point belongs to.
    grid : Grid
        Of a scheme that `can_step`.

    Yields
    ------
    (time, row) : tuple
        The collocation point and ``(body, 0)``, the tuple form of an equality constraint.
    """
    for nodes, (stage,) in zip(grid.node_times, grid.stage_times, strict=True):
        yield stage, (state[nodes[-1]] - following[stage], 0)
