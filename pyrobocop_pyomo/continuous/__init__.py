"""Models written with `pyomo.dae`: discretised by the schemes of this package, and read back."""

from .reading import dae_trajectory
from .transformation import Collocation

__all__ = ["Collocation", "dae_trajectory"]
