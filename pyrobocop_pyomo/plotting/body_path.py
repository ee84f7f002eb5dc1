"""A rigid body over time, as numbers: what the pictures of scenes are made of."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.errors import GeometryError
from pyrobocop_pyomo.geometry import Polytope

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BodyPath:
    """A body of one or several convex parts, and where it is at each time.

    Attributes
    ----------
    parts : Polytope, or sequence of Polytope
        In the frame of the body.
    rotation : array, shape (T, d, d)
        At each time.
    translation : array, shape (T, d)
        Of the body's reference point, the origin of its frame.
    name : str
    """

    parts: Polytope | Sequence[Polytope]
    rotation: Array
    translation: Array
    name: str = "body"

    def __post_init__(self) -> None:
        parts = (self.parts,) if isinstance(self.parts, Polytope) else tuple(self.parts)
        rotation, translation = np.asarray(self.rotation, float), np.asarray(self.translation, float)
        d = translation.shape[-1] if translation.ndim == 2 else 0
        if rotation.shape != (len(translation), d, d) or any(part.dimension != d for part in parts):
            raise GeometryError(
                f"body '{self.name}': parts of dimension {[part.dimension for part in parts]}, rotations of shape "
                f"{rotation.shape}, translations of shape {translation.shape}; expected are (T, d, d) and (T, d)."
            )
        object.__setattr__(self, "parts", parts)
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation", translation)

    @classmethod
    def planar(cls, parts: Any, x: Any, y: Any, theta: Any, name: str = "body") -> BodyPath:
        """From arrays of positions and of rotations in radians, shape (T,) each."""
        c, s = np.cos(np.asarray(theta, float)), np.sin(np.asarray(theta, float))
        rotation = np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0)
        return cls(parts, rotation, np.column_stack([x, y]), name)

    @property
    def dimension(self) -> int:
        """Two or three."""
        return int(self.translation.shape[1])

    def places(self) -> Array:
        """All vertices over time, shape (T, v, d): how far the body has moved is read from them."""
        corners = np.concatenate([part.vertices for part in self.parts])  # type: ignore[union-attr]
        return corners @ self.rotation.transpose(0, 2, 1) + self.translation[:, None, :]

    def at(self, i: int, polygons: Sequence[Array]) -> Iterator[Array]:
        """Polygons of the body's frame, moved to where the body is at the i-th time."""
        for polygon in polygons:
            yield polygon @ self.rotation[i].T + self.translation[i]
