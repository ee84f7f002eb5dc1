"""Builders of variables' guesses, collocation rows and quadrature on a grid, for any Pyomo block."""

from .collocation_rows import collocation_rows, continuity_rows
from .guesses import Guess, guess_at, number_guess, stage_guess, state_guess
from .quadrature import quadrature

__all__ = [
    "Guess",
    "collocation_rows",
    "continuity_rows",
    "guess_at",
    "number_guess",
    "quadrature",
    "stage_guess",
    "state_guess",
]
