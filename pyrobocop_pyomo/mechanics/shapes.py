"""Shapes whose core is a point, a segment or a box, padded by a radius, and their smooth gaps to discs and spheres.

Formulas are plain arithmetic for numbers, arrays and Pyomo expressions.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pyomo.core.expr import sqrt as expression_sqrt

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.geometry.poses import dot

from .rotations import Matrix, Vector, rotation_rows


class Names(NamedTuple):
    """What phases call the motion of bodies and robots, in the plane or in space.

    Attributes
    ----------
    axes : tuple of str
        Coordinates of a robot; its velocity and its driving force are named after them.
    position, orientation : tuple of str
        Of a body. Its orientation is an angle, or the entries of a rotation matrix by rows.
    twist, wrench : tuple of str
        Velocity and angular velocity; force and moment.
    tangential : tuple of str
        Forces of a contact along its tangents, then against them.
    """

    axes: tuple[str, ...]
    position: tuple[str, ...]
    orientation: tuple[str, ...]
    twist: tuple[str, ...]
    wrench: tuple[str, ...]
    tangential: tuple[str, ...]


PLANE = Names(
    axes=("x", "y"),
    position=("qx", "qy"),
    orientation=("qth",),
    twist=("ux", "uy", "uth"),
    wrench=("fx", "fy", "mz"),
    tangential=("alpha_plus", "alpha_minus"),
)
SPACE = Names(
    axes=("x", "y", "z"),
    position=("qx", "qy", "qz"),
    orientation=tuple(f"R{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3)),
    twist=("ux", "uy", "uz", "wx", "wy", "wz"),
    wrench=("fx", "fy", "fz", "mx", "my", "mz"),
    tangential=("alpha_1", "alpha_2", "alpha_3", "alpha_4"),
)


class Gap(NamedTuple):
    """How a disc or a sphere stands to a body: numbers, arrays or expressions, in the directions of the world.

    Attributes
    ----------
    gap : number or expression
        Distance of the surfaces, metres; negative where they overlap.
    normal : numbers or expressions
        Unit vector from the body to the disc or sphere.
    point : numbers or expressions
        From the body's origin to the point of its surface that is nearest to the disc or sphere, metres.
    """

    gap: Any
    normal: Vector
    point: Vector


@dataclass(frozen=True)
class RoundedShape:
    """A core, a point or a segment or a box, padded by a radius.

    The gap to a disc or a sphere is the distance of its centre from the core, less both radii. Where the nearest point
    of the core jumps from its inside to an end, the formula is smoothed over about `smoothing`, and so it is infinitely
    often differentiable wherever the centre is outside the core. There is one contact point, also along flat sides.

    Attributes
    ----------
    radius : float
        Padding of the core, metres.
    """

    names: ClassVar[Names]
    # Added to squared lengths before their root is taken, square metres: a length of zero would have no derivative.
    _small_area: ClassVar[float]

    radius: float
    smoothing = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and (value > 0 or (name == "radius" and value >= 0))):
                raise ObstacleError(f"{type(self).__name__}: {name} = {value!r}; expected a positive length in metres.")

    @property
    def core(self) -> tuple[float, ...]:
        """Half the length of the core along each axis of the body, metres; 0 along those that a shape does not name."""
        names = ("half_length", "half_width", "half_height")
        return tuple(getattr(self, name, 0.0) for name, _ in zip(names, self.names.axes, strict=False))

    @property
    def is_round(self) -> bool:
        """True when no rotation changes the shape."""
        return not any(self.core)

    def gap_to_ball(self, radius: float, centre: Vector, position: Vector, rotation: Matrix | None = None) -> Gap:
        """The gap to a disc or a sphere.

        Parameters
        ----------
        radius : float
            Of the disc or sphere, metres.
        centre : numbers, arrays or expressions
            Of the disc or sphere in the world, metres.
        position : numbers, arrays or expressions
            Of the body's origin, metres.
        rotation : rows of a matrix, optional
            Of the body; not read where the shape is round.

        Returns
        -------
        Gap
        """
        apart = [c - q for c, q in zip(centre, position, strict=True)]
        core: Vector = (0.0,) * len(apart)
        if not self.is_round:
            if rotation is None:
                raise ObstacleError(f"{type(self).__name__}: its gap needs the rotation of the body.")
            # The point of the core that is nearest, in the frame of the body.
            along = [dot(column, apart) for column in zip(*rotation, strict=True)]
            in_frame = [
                limited(x, half, self.smoothing) if half else 0.0 for x, half in zip(along, self.core, strict=True)
            ]
            core = [dot(row, in_frame) for row in rotation]
            apart = [d - k for d, k in zip(apart, core, strict=True)]
        length = root(dot(apart, apart) + self._small_area)
        normal = [d / length for d in apart]
        return Gap(
            length - self.radius - radius, normal, [k + self.radius * n for k, n in zip(core, normal, strict=True)]
        )

    def outline(self) -> Polytope:
        """The same shape for pictures and exact distances, without smoothing."""
        if all(self.core):
            return Polytope.box(*(2 * half for half in self.core)).padded(self.radius)
        ends = product(*((-half, half) if half else (0.0,) for half in self.core))
        return Polytope.from_vertices(list(ends), radius=self.radius, allow_flat=True)


def limited(value: Any, limit: float, smoothing: float) -> Any:
    """``min(max(value, -limit), limit)``, smoothed: off by at most half the smoothing, at the limits."""
    return (root((value + limit) ** 2 + smoothing**2) - root((value - limit) ** 2 + smoothing**2)) / 2


def root(value: Any) -> Any:
    """Square root of a number, an array or an expression."""
    return np.sqrt(value) if isinstance(value, np.ndarray) else expression_sqrt(value)


class PlanarShape(RoundedShape):
    """A shape in the plane; see `RoundedShape`."""

    names = PLANE
    _small_area = 1e-6

    def gap_to_disc(self, disc_radius: float, x: Any, y: Any, pose: Vector = (0.0, 0.0, 0.0)) -> Gap:
        """The gap to a disc.

        Parameters
        ----------
        disc_radius : float
            Metres.
        x, y : number, array or expression
            Centre of the disc in the world, metres.
        pose : (x, y, theta)
            Of the body: metres and radians, numbers, arrays or expressions.

        Returns
        -------
        Gap
            In the directions of the world; the contact point is relative to the body's origin.
        """
        return self.gap_to_ball(disc_radius, (x, y), pose[:2], rotation_rows(pose[2:]))


class SpatialShape(RoundedShape):
    """A shape in space; see `RoundedShape`."""

    names = SPACE
    _small_area = 1e-12

    gap_to_sphere = RoundedShape.gap_to_ball


class Disc(PlanarShape):
    """A disc around the origin of the body's frame."""


@dataclass(frozen=True)
class Capsule(PlanarShape):
    """A segment on the body's x axis, padded: a rod with round ends.

    Attributes
    ----------
    radius : float
        Metres.
    half_length : float
        Of the segment, metres; the rod reaches `radius` further.
    smoothing : float
        Length over which the ends of the segment are smoothed, metres.
    """

    half_length: float
    smoothing: float = 0.01


@dataclass(frozen=True)
class RoundedBox(PlanarShape):
    """A rectangle with rounded corners.

    The gap serves discs whose centre stays outside the core. An overlap of more than the radii is not told from a
    touch in the core's middle.

    Attributes
    ----------
    radius : float
        Of the corners, metres.
    half_length, half_width : float
        Of the core, along x and y, metres; the box reaches `radius` further on each side.
    smoothing : float
        Length over which the corners of the core are smoothed, metres.
    """

    half_length: float
    half_width: float
    smoothing: float = 0.01


class Sphere(SpatialShape):
    """A sphere around the origin of the body's frame."""


@dataclass(frozen=True)
class SpatialCapsule(SpatialShape):
    """A segment on the body's x axis, padded: a rod with round ends.

    Attributes
    ----------
    radius : float
        Metres.
    half_length : float
        Of the segment, metres; the rod reaches `radius` further.
    smoothing : float
        Length over which the ends of the segment are smoothed, metres.
    """

    half_length: float
    smoothing: float = 0.01


@dataclass(frozen=True)
class SpatialBox(SpatialShape):
    """A box with rounded edges.

    The gap serves spheres whose centre stays outside the core. An overlap of more than the radii is not told from a
    touch in the core's middle.

    Attributes
    ----------
    radius : float
        Of the edges, metres.
    half_length, half_width, half_height : float
        Of the core, along x, y and z, metres; the box reaches `radius` further on each side.
    smoothing : float
        Length over which the edges of the core are smoothed, metres.
    """

    half_length: float
    half_width: float
    half_height: float
    smoothing: float = 0.01
