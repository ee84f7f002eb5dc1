"""Forward kinematics of a tree of joints, in numbers or in Pyomo expressions alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.expr import cos, sin

from pyrobocop_pyomo.geometry import Pose
from pyrobocop_pyomo.geometry.poses import dot
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.rounding import ROUNDING

TURNING = ("revolute", "continuous")
WITH_ONE_COORDINATE = (*TURNING, "prismatic")


@dataclass(frozen=True, eq=False)
class Joint:
    """One joint: where it is on its parent link, and how it moves its child.

    Attributes
    ----------
    name, kind, parent : str
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
    origin: np.ndarray
    axis: np.ndarray
    limits: tuple[float, float]
    mimics: tuple[str, float, float] | None = None

    @property
    def moves(self) -> bool:
        """Whether its child moves relative to its parent."""
        return self.kind != "fixed"

    @property
    def leader(self) -> str:
        """The joint whose coordinate moves it: another one, where it mimics that."""
        return self.name if self.mimics is None else self.mimics[0]

    def pose(self, coordinate: Any) -> Pose:
        """Pose of the child in the frame of the parent."""
        fixed = constant_pose(self.origin)
        if not self.moves:
            return fixed
        if self.kind == "prismatic":
            return fixed @ Pose(Pose.identity(3).rotation, tuple(dot((float(a),), (coordinate,)) for a in self.axis))
        return fixed @ _turn_about(self.axis, coordinate)


def constant_pose(matrix: np.ndarray) -> Pose:
    """A pose of numbers from a homogeneous matrix."""
    return Pose(_rounded(matrix[:3, :3]).tolist(), np.asarray(matrix[:3, 3], dtype=float).tolist())


def _rounded(factors: Array) -> Array:
    """Numbers of which zeros and ones are exact, as sin(pi) and the like are meant: products with them vanish."""
    rounded = np.array(factors, dtype=float)
    for exact in (-1.0, 0.0, 1.0):
        rounded[np.abs(rounded - exact) <= ROUNDING] = exact
    return rounded


def _turn_about(axis: np.ndarray, angle: Any) -> Pose:
    """Rodrigues' formula ``u u' + (I - u u') cos(angle) + [u] sin(angle)``."""
    along = np.outer(axis, axis)
    crossed = np.cross(axis, np.eye(3), axisb=1).T  # columns: axis x unit vector
    factors = _rounded(np.stack([along, np.eye(3) - along, crossed], axis=2))
    terms = (1.0, cos(angle), sin(angle))
    return Pose(tuple(tuple(dot(entry, terms) for entry in row) for row in factors.tolist()), (0.0, 0.0, 0.0))


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

    def pose(self, link: str, coordinate_of: Callable[[str], Any], base: Pose) -> Pose:
        """Pose of a link in the world, from the coordinate (number, expression) by the name of a joint."""
        pose = base
        for joint in self.chain(link):
            coordinate: Any = coordinate_of(joint.leader) if joint.moves else None
            if joint.moves and joint.mimics is not None:
                _, factor, offset = joint.mimics
                coordinate = factor * coordinate + offset
            pose = pose @ joint.pose(coordinate)
        return pose

    def rigid_group(self, link: str) -> str:
        """The link nearest to the root that a link is fixed to: both never move relative to each other."""
        while link != self.root and not self.joints[link].moves:
            link = self.joints[link].parent
        return link
