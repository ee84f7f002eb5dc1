"""Formulations of a separation of two shapes, one per file."""

from .dual import Dual
from .mixed import Mixed
from .offset import Offset
from .optimality import Optimality
from .plane import Plane
from .protocol import Formulation, PlacedShape, PosedShape, SeparationIndex
from .turning_plane import TurningPlane

FORMULATIONS: dict[str, Formulation] = {
    formulation.name: formulation for formulation in (Plane(), Dual(), Mixed(), Offset(), Optimality(), TurningPlane())
}

__all__ = [
    "FORMULATIONS",
    "Dual",
    "Formulation",
    "Mixed",
    "Offset",
    "Optimality",
    "PlacedShape",
    "Plane",
    "PosedShape",
    "SeparationIndex",
    "TurningPlane",
]
