"""Builders of rows and quadrature on a grid, for any Pyomo block."""

from .collocation_rows import can_step, collocation_row, collocation_rows, continuity_rows, quadrature

__all__ = ["can_step", "collocation_row", "collocation_rows", "continuity_rows", "quadrature"]
