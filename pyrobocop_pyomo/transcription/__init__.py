"""Builders of rows and quadrature on a grid, for any Pyomo block."""

from .collocation_rows import (
    can_step,
    collocation_row,
    collocation_rows,
    collocation_sums,
    continuity_rows,
    place_of,
    quadrature,
    row_times,
)

__all__ = [
    "can_step",
    "collocation_row",
    "collocation_rows",
    "collocation_sums",
    "continuity_rows",
    "place_of",
    "quadrature",
    "row_times",
]
