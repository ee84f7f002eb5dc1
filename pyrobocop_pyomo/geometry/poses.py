"""Poses: a rotation and a translation whose entries are numbers or Pyomo expressions alike."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pyomo.core.expr import cos, sin
from pyomo.core.expr.numvalue import native_numeric_types, value

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.modeling.expression_arrays import plain_entry

logger = logging.getLogger(__name__)

Entry = Any  # a number, or a Pyomo expression

# Two turns: angles wind up, but a larger one was most likely given in degrees.
LARGEST_USUAL_ANGLE = 4.0 * math.pi


@dataclass(frozen=True)
class Pose:
    """A body's frame in the world: the body's point z is at ``rotation @ z + translation``.

    Parameters
    ----------
    rotation : d tuples of d entries
        Rows of a rotation matrix.
    translation : tuple of d entries
        Where the origin of the body's frame is.
    angles : tuple of entries, optional
        What the rotation was made of, for messages only.
    """

    rotation: tuple[tuple[Entry, ...], ...]
    translation: tuple[Entry, ...]
    angles: tuple[Entry, ...] = field(default=(), compare=False, repr=False)

    def __post_init__(self) -> None:
        # Rules may compute with arrays of expressions; plain expressions are kept.
        object.__setattr__(self, "rotation", tuple(tuple(map(plain_entry, row)) for row in self.rotation))
        object.__setattr__(self, "translation", tuple(map(plain_entry, self.translation)))

    @classmethod
    def identity(cls, dimension: int) -> Pose:
        """The pose of a body whose frame is the world's."""
        return cls(_identity(dimension), (0.0,) * dimension)

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return len(self.translation)

    @property
    def is_constant(self) -> bool:
        """Whether all entries are plain numbers."""
        return all(is_number(entry) for entry in self.entries)

    def apply(self, point: Sequence[Entry]) -> tuple[Entry, ...]:
        """World coordinates of a point of the body; products with zeros and ones are left out."""
        if len(point) != self.dimension:
            raise ObstacleError(
                f"a pose in {self.dimension} dimensions was applied to a point with {len(point)} coordinates. "
                "Give both in the plane, or both in space."
            )
        return tuple(_plus(dot(row, point), shift) for row, shift in zip(self.rotation, self.translation, strict=True))

    def __matmul__(self, other: Pose) -> Pose:
        """The pose of a body that has the pose `other` in a frame that has this pose: for arms and trailers."""
        if not isinstance(other, Pose):
            return NotImplemented
        rotation = _product(self.rotation, other.rotation) if self.dimension == other.dimension else ()
        return Pose(rotation, self.apply(other.translation), self.angles + other.angles)

    def numbers(self) -> tuple[np.ndarray, np.ndarray]:
        """Rotation (d, d) and translation (d,) at the current values.

        Raises
        ------
        ObstacleError
            If a variable in an entry has no value.
        """
        dimension = self.dimension
        rotation = [_value(entry) for row in self.rotation for entry in row]
        return np.array(rotation).reshape(dimension, dimension), np.array([_value(e) for e in self.translation])

    @property
    def entries(self) -> list[Entry]:
        """The rotation row by row, then the translation."""
        return [*(entry for row in self.rotation for entry in row), *self.translation]


def planar_pose(x: Entry, y: Entry, theta: Entry = 0.0) -> Pose:
    """Pose in the plane: turned by theta (radians, counter-clockwise), then moved to (x, y).

    Entries are numbers or Pyomo expressions; numbers give a pose of numbers.
    """
    return Pose(_turn(theta), (x, y), (theta,))


def spatial_pose(
    position: Sequence[Entry],
    *,
    euler: Sequence[Entry] | None = None,
    quaternion: Sequence[Entry] | None = None,
    matrix: Sequence[Sequence[Entry]] | None = None,
) -> Pose:
    """Pose in space; the rotation is given in one of three ways, or left out.

    Parameters
    ----------
    position : three entries
    euler : (roll, pitch, yaw), optional
        Radians; the rotation is ``Rz(yaw) Ry(pitch) Rx(roll)``.
    quaternion : (w, x, y, z), optional
        Of length one: nothing here normalises it. A model's own must be held at length one by a constraint.
    matrix : three rows of three entries, optional

    Raises
    ------
    ObstacleError
        If more than one rotation is given, or one of the wrong size.
    """
    given = [
        name for name, what in (("euler", euler), ("quaternion", quaternion), ("matrix", matrix)) if what is not None
    ]
    if len(given) > 1:
        raise ObstacleError(f"spatial_pose: {' and '.join(given)} are given; give one of them.")
    position = _sized(position, 3, "position: (x, y, z)")
    if euler is not None:
        roll, pitch, yaw = _sized(euler, 3, "euler: (roll, pitch, yaw)")
        about_x = _embedded(_turn(roll), (1, 2))
        about_y = _embedded(_turn(pitch), (2, 0))
        about_z = _embedded(_turn(yaw), (0, 1))
        return Pose(_product(_product(about_z, about_y), about_x), position, (roll, pitch, yaw))
    if quaternion is not None:
        return Pose(_of_quaternion(*_sized(quaternion, 4, "quaternion: (w, x, y, z)")), position)
    if matrix is not None:
        rows = _sized(matrix, 3, "matrix: three rows")
        return Pose(tuple(_sized(row, 3, "matrix: rows of three entries") for row in rows), position)
    return Pose(_identity(3), position)


def check_pose(pose: Pose, name: str, *, tolerance: float = 1e-6) -> None:
    """Refuse a pose whose matrix is no rotation at the current values: stretched, sheared or mirrored.

    Raises
    ------
    ObstacleError
        Naming the body, if an entry has no finite value, or the rotation is not orthonormal with determinant +1.
    """
    try:
        rotation, translation = pose.numbers()
    except ObstacleError as error:
        raise ObstacleError(f"'{name}': {error}") from None
    if not (np.isfinite(rotation).all() and np.isfinite(translation).all()):
        raise ObstacleError(f"'{name}': the pose has entries that are not finite:\n{rotation}\n{translation}.")
    deviation = float(np.abs(rotation @ rotation.T - np.eye(pose.dimension)).max())
    if deviation > tolerance:
        raise ObstacleError(
            f"'{name}': the pose's rotation R is none: R R' differs from the identity by {deviation:.3g}. "
            "Check the signs of sines and cosines; a quaternion must have length one, as a start value too."
        )
    if np.linalg.det(rotation) < 0.0:
        raise ObstacleError(
            f"'{name}': the pose's rotation mirrors the body (its determinant is -1). Check the signs of the "
            "sines, and that all axes are right-handed."
        )
    for angle in pose.angles:
        turned = _value(angle)
        if abs(turned) > LARGEST_USUAL_ANGLE:
            logger.warning("'%s': an angle of its pose is %.4g; angles are in radians, not in degrees.", name, turned)


def is_number(entry: Entry) -> bool:
    """True for plain numbers, False for expressions."""
    return entry.__class__ in native_numeric_types


def _value(entry: Entry) -> float:
    number = entry if is_number(entry) else value(entry, exception=False)
    if number is None:
        raise ObstacleError(f"the pose's entry {entry} has no value. Give its variables start values first.")
    return float(number)


def _turn(angle: Entry) -> tuple[tuple[Entry, ...], ...]:
    cosine, sine = cos(angle), sin(angle)
    return ((cosine, -sine), (sine, cosine))


def _embedded(turn: tuple[tuple[Entry, ...], ...], plane: tuple[int, int]) -> tuple[tuple[Entry, ...], ...]:
    rows: list[list[Entry]] = [list(row) for row in _identity(3)]
    for i, row in zip(plane, turn, strict=True):
        for j, entry in zip(plane, row, strict=True):
            rows[i][j] = entry
    return tuple(tuple(row) for row in rows)


def _of_quaternion(w: Entry, x: Entry, y: Entry, z: Entry) -> tuple[tuple[Entry, ...], ...]:
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


def _identity(dimension: int) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(1.0 if i == j else 0.0 for j in range(dimension)) for i in range(dimension))


def _sized(entries: Sequence[Entry], size: int, label: str) -> tuple[Entry, ...]:
    if len(entries) != size:
        raise ObstacleError(f"spatial_pose: {label} was expected, and {len(entries)} were given.")
    return tuple(entries)


def _product(left: Sequence[Sequence[Entry]], right: Sequence[Sequence[Entry]]) -> tuple[tuple[Entry, ...], ...]:
    return tuple(tuple(dot(row, column) for column in zip(*right, strict=True)) for row in left)


def dot(left: Sequence[Entry], right: Sequence[Entry]) -> Entry:
    """Sum of products, without terms that are zero and factors of one."""
    total: Entry = 0.0
    for a, b in zip(left, right, strict=True):
        total = _plus(total, _times(a, b))
    return total


def _plus(a: Entry, b: Entry) -> Entry:
    if is_number(a) and a == 0:
        return b
    return a if is_number(b) and b == 0 else a + b


def _times(a: Entry, b: Entry) -> Entry:
    for this, that in ((a, b), (b, a)):
        if is_number(this) and this in (0, 1):
            return that if this == 1 else 0.0
    return a * b
