"""Builders of variables' guesses, rows and quadrature on a grid, for any Pyomo block."""

from .collocation_rows import can_step, collocation_row, collocation_rows, continuity_rows, quadrature
from .initial_guesses import InitialGuess, initial_number, initial_stage_values, initial_state_values, initial_values_at

__all__ = [
    "InitialGuess",
    "can_step",
    "collocation_row",
    "collocation_rows",
    "continuity_rows",
    "initial_number",
    "initial_stage_values",
    "initial_state_values",
    "initial_values_at",
    "quadrature",
]
