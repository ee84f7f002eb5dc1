"""Builders of rows and quadrature on a grid, for any Pyomo block."""

from .collocation_rows import can_step, collocation_row, collocation_sums, continuity_row, quadrature

__all__ = [
    "can_step",
    "collocation_row",
    "collocation_sums",
    "continuity_row",
    "quadrature",
]
