"""`Snapshot`: poses and corners at the current values of the variables, and the gaps that normals prove there."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.modeling.shared_nodes import variables_in_any
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.optional_imports import scipy

from .avoidance_record import AvoidanceRecord, MotionSegment
from .planes import PlacedShape
from .scene import ConvexPart

Numbers = tuple[np.ndarray, np.ndarray]


class Snapshot:
    """Poses and corners at the current values; each pose is evaluated once.

    Parameters
    ----------
    record : AvoidanceRecord
    what : str
        Name of the block in messages.
    """

    def __init__(self, record: AvoidanceRecord, label: str) -> None:
        self.record = record
        self.what = label
        self._poses: dict[tuple[str, Hashable], Numbers] = {}
        self._vertices: dict[tuple[str, Hashable], np.ndarray] = {}
        self._shapes: dict[tuple[str, Hashable], PlacedShape] = {}

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
        empty = [variable.name for variable in variables_of(pose) if variable.value is None]
        if empty:
            raise ObstacleError(
                f"{self.what}: the pose of '{body}' at {time} reads '{empty[0]}', which has no value. Give the motion "
                "an initial guess first."
            )
        rotation, translation = pose.numbers()
        if not (np.isfinite(rotation).all() and np.isfinite(translation).all()):
            raise ObstacleError(f"{self.what}: the pose of '{body}' at {time} is not finite at the current values.")
        return rotation, translation

    def vertices(self, part: ConvexPart, times: Iterable[Hashable]) -> np.ndarray:
        """Vertices (k, d) in the world at all the times."""
        if self.record.scene.is_static(part.body):
            return part.shape.vertices
        return np.vstack([self._vertices_at(part, time) for time in times])

    def _vertices_at(self, part: ConvexPart, time: Hashable) -> np.ndarray:
        key = (part.name, time)
        if key not in self._vertices:
            rotation, translation = self.pose(part.body, time)
            self._vertices[key] = part.shape.vertices @ rotation.T + translation
        return self._vertices[key]

    def rays(self, part: ConvexPart, times: Iterable[Hashable]) -> np.ndarray:
        """Rays (k, d) in the world at all the times."""
        if not len(part.shape.rays) or self.record.scene.is_static(part.body):
            return part.shape.rays
        return np.vstack([part.shape.rays @ self.pose(part.body, time)[0].T for time in times])

    def placed_pair(self, segment: MotionSegment) -> tuple[PlacedShape, PlacedShape]:
        """Both shapes of a segment of motion."""
        first, second = (
            self._placed(self.record.scene.parts[name], segment) for name in (segment.first, segment.second)
        )
        return first, second

    def _placed(self, part: ConvexPart, segment: MotionSegment) -> PlacedShape:
        key = (part.name, None if self.record.scene.is_static(part.body) else segment.times)
        if key not in self._shapes:
            vertices, rays = self.vertices(part, segment.times), self.rays(part, segment.times)
            self._shapes[key] = PlacedShape(part.shape, vertices, rays)
        return self._shapes[key]


def variables_of(pose: Any) -> list[Any]:
    """Variables that a pose reads, the fixed ones included."""
    return list(variables_in_any(pose.entries).values())


def fixed_times(poses: Mapping[tuple[str, Hashable], Any], body: str) -> dict[Any, None]:
    """Times at which all that the pose of a moving body reads is fixed."""
    return {
        time: None
        for (name, time), pose in poses.items()
        if name == body and all(variable.fixed for variable in variables_of(pose))
    }


def gap_along(normals: np.ndarray, first: PlacedShape, second: PlacedShape) -> np.ndarray:
    """Gaps (k,) between two shapes along each of the unit normals (k, d), radii included."""
    reach = (first.vertices @ normals.T).min(axis=0) - (second.vertices @ normals.T).max(axis=0)
    return reach - first.shape.radius - second.shape.radius


def proven_gap(first: PlacedShape, second: PlacedShape, normal: np.ndarray) -> float:
    """Distance that a normal of any length proves; never more than the signed distance of the swept shapes.

    A normal of zero proves nothing, which is ``-inf``. Where shapes are unbounded, the normal is first projected onto
    the directions along which both are bounded.
    """
    rays = np.vstack([second.rays, -first.rays])
    if len(rays):
        # The residual of the projection onto the cone of the rays makes no acute angle with any of them.
        normal = normal - rays.T @ scipy.optimize.nnls(rays.T, normal)[0]
    length = float(np.linalg.norm(normal))
    if not length > NEGLIGIBLE:
        return -float("inf")
    return float(gap_along((normal / length)[None, :], first, second)[0])
