"""Formulations of "these two shapes are apart", one per file."""

from .plane import Plane
from .protocol import Formulation, PlacedSide, Side

FORMULATIONS: dict[str, Formulation] = {each.name: each for each in (Plane(),)}

__all__ = ["FORMULATIONS", "Formulation", "PlacedSide", "Plane", "Side"]
