"""Where everything is at the current values of the variables, in numbers."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from typing import Any

import numpy as np
from pyomo.core.expr.visitor import identify_variables

from pyrobocop_pyomo.errors import ObstacleError

from .avoidance_record import AvoidanceRecord, Piece
from .formulations import PlacedSide
from .formulations.rows import is_number
from .scene import Part

Numbers = tuple[np.ndarray, np.ndarray]


class Snapshot:
    """Poses and vertices at the current values; each pose is evaluated once.

    Parameters
    ----------
    record : AvoidanceRecord
    what : str
        How messages call the block.
    """

    def __init__(self, record: AvoidanceRecord, what: str) -> None:
        self.record = record
        self.what = what
        self._poses: dict[tuple[str, Hashable], Numbers] = {}
        self._vertices: dict[tuple[str, Hashable], np.ndarray] = {}

    def pose(self, body: str, time: Hashable) -> Numbers:
        """Rotation (d, d) and translation (d,) of a body.

        Raises
        ------
        ObstacleError
            When the pose reads a variable that has no value, or is not finite.
        """
        key = (body, None if self.record.scene.is_static(body) else time)
        if key not in self._poses:
            self._poses[key] = self._evaluated(body, time, self.record.poses[key])
        return self._poses[key]

    def _evaluated(self, body: str, time: Hashable, pose: Any) -> Numbers:
        empty = [each.name for each in variables_of(pose) if each.value is None]
        if empty:
            raise ObstacleError(
                f"{self.what}: the pose of '{body}' at {time} reads '{empty[0]}', which has no value. Give the motion "
                "a guess first."
            )
        rotation, translation = pose.numbers()
        if not (np.isfinite(rotation).all() and np.isfinite(translation).all()):
            raise ObstacleError(f"{self.what}: the pose of '{body}' at {time} is not finite at the current values.")
        return rotation, translation

    def vertices(self, part: Part, times: Iterable[Hashable]) -> np.ndarray:
        """Vertices (k, d) in the world at all the times."""
        if self.record.scene.is_static(part.body):
            return part.shape.vertices
        return np.vstack([self._vertices_at(part, time) for time in times])

    def _vertices_at(self, part: Part, time: Hashable) -> np.ndarray:
        key = (part.name, time)
        if key not in self._vertices:
            rotation, translation = self.pose(part.body, time)
            self._vertices[key] = part.shape.vertices @ rotation.T + translation
        return self._vertices[key]

    def rays(self, part: Part, times: Iterable[Hashable]) -> np.ndarray:
        """Rays (k, d) in the world at all the times."""
        if not len(part.shape.rays) or self.record.scene.is_static(part.body):
            return part.shape.rays
        return np.vstack([part.shape.rays @ self.pose(part.body, time)[0].T for time in times])

    def sides(self, piece: Piece) -> tuple[PlacedSide, PlacedSide]:
        """Both sides of a piece of motion."""
        first, second = (self._placed(self.record.scene.parts[name], piece) for name in (piece.first, piece.second))
        return first, second

    def _placed(self, part: Part, piece: Piece) -> PlacedSide:
        rotation, translation = self.pose(part.body, piece.times[0])
        vertices, rays = self.vertices(part, piece.times), self.rays(part, piece.times)
        return PlacedSide(part.shape, vertices, rays, rotation, translation)


def variables_of(pose: Any) -> list[Any]:
    """Variables that a pose reads, the fixed ones included."""
    entries = [*(entry for row in pose.rotation for entry in row), *pose.translation]
    found: dict[int, Any] = {}
    for entry in entries:
        if not is_number(entry):
            found.update({id(each): each for each in identify_variables(entry, include_fixed=True)})
    return list(found.values())
