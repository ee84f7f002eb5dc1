"""Models written with `pyomo.dae`: discretised by the schemes of this package, and read back."""

from .transformation import Collocation
from .values import dae_trajectory

__all__ = ["Collocation", "dae_trajectory"]
