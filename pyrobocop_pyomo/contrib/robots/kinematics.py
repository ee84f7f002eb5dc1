"""Forward kinematics of a tree of joints, in numbers or in Pyomo expressions alike."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.expr import cos, sin

from pyrobocop_pyomo.geometry import Pose
from pyrobocop_pyomo.numerics.rounding import ROUNDING

TURNING = ("revolute", "continuous")
WITH_ONE_COORDINATE = (*TURNING, "prismatic")
WITH_A_POSE = ("floating", "planar")


@dataclass(frozen=True, eq=False)
class Joint:
    """One joint: where it is on its parent link, and how it moves its child.

    Attributes
    ----------
    name, kind, parent, child : str
    origin : array, shape (4, 4)
    axis : array, shape (3,)
        Unit vector in the frame of the joint.
    limits : (float, float)
        Infinite where there are none.
    mimics : (str, float, float) or None
        Another joint, and the factor and offset of this joint's coordinate from its one.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: np.ndarray
    axis: np.ndarray
    limits: tuple[float, float]
    mimics: tuple[str, float, float] | None = None

    @property
    def moves(self) -> bool:
        """Whether its child moves relative to its parent."""
        return self.kind != "fixed"

    def pose(self, coordinate: Any) -> Pose:
        """Pose of the child in the frame of the parent; a joint without one coordinate is given the pose itself."""
        fixed = constant_pose(self.origin)
        if not self.moves:
            return fixed
        if self.kind in WITH_A_POSE:
            return fixed @ coordinate
        if self.kind == "prismatic":
            return fixed @ Pose(Pose.identity(3).rotation, tuple(_times(float(a), coordinate) for a in self.axis))
        return fixed @ _turn_about(self.axis, coordinate)


def constant_pose(matrix: np.ndarray) -> Pose:
    """A pose of numbers from a homogeneous matrix; zeros and ones are exact, so that products with them vanish."""
    rotation = np.array(matrix[:3, :3], dtype=float)
    for exact in (-1.0, 0.0, 1.0):  # sin(pi) and the like are meant to be
        rotation[np.abs(rotation - exact) <= ROUNDING] = exact
    return Pose(tuple(map(tuple, rotation.tolist())), tuple(np.asarray(matrix[:3, 3], dtype=float).tolist()))


def _times(factor: float, coordinate: Any) -> Any:
    if factor in (0.0, 1.0):
        return coordinate if factor == 1.0 else 0.0
    return factor * coordinate


def _turn_about(axis: np.ndarray, angle: Any) -> Pose:
    """Rodrigues' formula ``u u' + (I - u u') cos(angle) + [u] sin(angle)``."""
    along = np.outer(axis, axis)
    crossed = np.cross(axis, np.eye(3), axisb=1).T  # columns: axis x unit vector
    cosine, sine = cos(angle), sin(angle)
    rows = []
    for i in range(3):
        row: list[Any] = []
        for j in range(3):
            entry: Any = 0.0
            factors = (along[i, j], float(i == j) - along[i, j], crossed[i, j])
            for factor, term in zip(factors, (1.0, cosine, sine), strict=True):
                if abs(factor) > ROUNDING:
                    part = term if abs(factor - 1.0) <= ROUNDING else float(factor) * term
                    entry = part if isinstance(entry, float) and entry == 0.0 else entry + part
            row.append(entry)
        rows.append(tuple(row))
    return Pose(tuple(rows), (0.0, 0.0, 0.0))


@dataclass(frozen=True, eq=False)
class KinematicTree:
    """Links and joints of a robot.

    Attributes
    ----------
    root : str
        The link that no joint moves.
    joints : mapping of name of the child link to Joint
    """

    root: str
    joints: Mapping[str, Joint]

    def chain(self, link: str) -> list[Joint]:
        """Joints from the root to a link."""
        found: list[Joint] = []
        while link != self.root:
            found.append(self.joints[link])
            link = found[-1].parent
        return found[::-1]

    def pose(self, link: str, coordinates: Mapping[str, Any], base: Pose | None) -> Pose:
        """Pose of a link in the world, from coordinates (numbers, expressions, poses) by the name of the joint."""
        pose = base
        for joint in self.chain(link):
            step = joint.pose(coordinates.get(joint.name))
            pose = step if pose is None else pose @ step
        return Pose.identity(3) if pose is None else pose

    def rigid_group(self, link: str) -> str:
        """The link nearest to the root that a link is fixed to: both never move relative to each other."""
        while link != self.root and not self.joints[link].moves:
            link = self.joints[link].parent
        return link
