"""Formulations of "these two shapes are apart", one per file."""

from .dual import Dual
from .mixed import Mixed
from .offset import Offset
from .optimality import Optimality
from .plane import Plane
from .protocol import Formulation, PlacedSide, Side

FORMULATIONS: dict[str, Formulation] = {each.name: each for each in (Plane(), Dual(), Mixed(), Offset(), Optimality())}

__all__ = [
    "FORMULATIONS",
    "Dual",
    "Formulation",
    "Mixed",
    "Offset",
    "Optimality",
    "PlacedSide",
    "Plane",
    "Side",
]
