"""A direct solver for sparse symmetric indefinite matrices, in C, which any Ipopt can load in place of its own."""

from .factorisation import Factorised, FactorSize, SymmetricFactorisation, find_linear_solver

__all__ = ["FactorSize", "Factorised", "SymmetricFactorisation", "find_linear_solver"]
