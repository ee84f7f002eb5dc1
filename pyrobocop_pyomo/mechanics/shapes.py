"""Shapes whose core is a point, a segment or a box, padded by a radius: the same in the plane and in space."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from pyomo.core.expr import cos as expression_cos
from pyomo.core.expr import sin as expression_sin
from pyomo.core.expr import sqrt as expression_sqrt

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope


class RoundedShape:
    """What `PlanarShape` and `SpatialShape` have in common."""

    dimension: ClassVar[int]
    radius: float
    smoothing: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and (value > 0 or (name == "radius" and value >= 0))):
                raise ObstacleError(f"{type(self).__name__}: {name} = {value!r}; expected a positive length in metres.")

    @property
    def core(self) -> tuple[float, ...]:
        """Half the length of the core along each axis of the body, metres; 0 along those that a shape does not name."""
        names = ("half_length", "half_width", "half_height")[: self.dimension]
        return tuple(getattr(self, name, 0.0) for name in names)

    @property
    def is_round(self) -> bool:
        """True when no rotation changes the shape."""
        return not any(self.core)

    def nearest_of_core(self, *place: Any) -> tuple[Any, ...]:
        """The point of the core that is nearest to a place, in the frame of the body."""
        return tuple(
            limited(x, half, self.smoothing) if half else 0.0 for x, half in zip(place, self.core, strict=True)
        )

    def outline(self) -> Polytope:
        """The same shape for pictures and exact distances, without smoothing."""
        first, *others = self.core
        level = (0.0,) * len(others)
        if not first:
            return Polytope.ball(self.radius, (0.0, *level)) if self.radius else Polytope.point((0.0, *level))
        if not any(others):
            return Polytope.capsule((-first, *level), (first, *level), self.radius)
        return Polytope.box(*(2 * half for half in self.core)).padded(self.radius)


def limited(value: Any, limit: float, smoothing: float) -> Any:
    """``min(max(value, -limit), limit)``, smoothed: off by at most half the smoothing, at the limits."""
    return (root((value + limit) ** 2 + smoothing**2) - root((value - limit) ** 2 + smoothing**2)) / 2


def root(value: Any) -> Any:
    """Square root of a number, an array or an expression."""
    return np.sqrt(value) if isinstance(value, np.ndarray) else expression_sqrt(value)


def sine(value: Any) -> Any:
    """Sine of a number, an array or an expression."""
    return np.sin(value) if isinstance(value, np.ndarray) else expression_sin(value)


def cosine(value: Any) -> Any:
    """Cosine of a number, an array or an expression."""
    return np.cos(value) if isinstance(value, np.ndarray) else expression_cos(value)
