"""`Snapshot`: poses and corners at the current values of the variables, and the gaps that normals prove there."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.modeling.shared_nodes import variables_in_any
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.optional_imports import scipy

from .avoidance_record import AvoidanceRecord, MotionSegment

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
        self._shapes: dict[tuple[str, Hashable], Polytope] = {}

    def pose(self, body: str, time: Hashable) -> Numbers:
        """Rotation (d, d) and translation (d,) of a body.

        Raises
        ------
        ObstacleError
            When the pose reads a variable that has no value, or is not finite.
        """
        key = (body, None if self.record.scene.is_static(body) else time)
        if key not in self._poses:
            try:
                self._poses[key] = self.record.poses[key].numbers()
            except ObstacleError as error:
                raise ObstacleError(f"{self.what}: the pose of '{body}' at {time}: {error}") from None
            if not all(np.isfinite(entries).all() for entries in self._poses[key]):
                raise ObstacleError(f"{self.what}: the pose of '{body}' at {time} is not finite at the current values.")
        return self._poses[key]

    def placed_pair(self, segment: MotionSegment) -> tuple[Polytope, Polytope]:
        """What both shapes of a segment of motion sweep: their corners and rays at all times that it covers."""
        return self._placed(segment.first, segment.times), self._placed(segment.second, segment.times)

    def _placed(self, name: str, times: tuple[Any, ...]) -> Polytope:
        part = self.record.scene.parts[name]
        if self.record.scene.is_static(part.body):
            return part.shape
        if (name, times) not in self._shapes:
            poses = [self.pose(part.body, time) for time in times]
            vertices = np.vstack([part.shape.vertices @ rotation.T + translation for rotation, translation in poses])
            rays = np.vstack([part.shape.rays @ rotation.T for rotation, _ in poses])
            self._shapes[name, times] = replace(part.shape, vertices=vertices, rays=rays)
        return self._shapes[name, times]


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


def gap_along(normals: np.ndarray, first: Polytope, second: Polytope) -> np.ndarray:
    """Gaps (k,) between two shapes along each of the unit normals (k, d), radii included."""
    reach = (first.vertices @ normals.T).min(axis=0) - (second.vertices @ normals.T).max(axis=0)
    return reach - first.radius - second.radius


def proven_gap(first: Polytope, second: Polytope, normal: np.ndarray) -> float:
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
