"""Shapes in space and their smooth gaps to a sphere: plain arithmetic for numbers, arrays and Pyomo expressions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from pyrobocop_pyomo.errors import ObstacleError

from .rotations import Matrix, Vector, inner_product
from .shapes import RoundedShape, root

# Added to squared lengths before their root is taken, square metres: a length of zero would have no derivative.
_SMALL_AREA = 1e-12


class SpatialGap(NamedTuple):
    """How a sphere stands to a body: numbers, arrays or expressions, in one frame.

    Attributes
    ----------
    gap : number or expression
        Distance of the surfaces, metres; negative where they overlap.
    normal_x, normal_y, normal_z : number or expression
        Unit vector from the body to the sphere.
    point_x, point_y, point_z : number or expression
        From the body's origin to the point of its surface that is nearest to the sphere, metres.
    """

    gap: Any
    normal_x: Any
    normal_y: Any
    normal_z: Any
    point_x: Any
    point_y: Any
    point_z: Any

    @property
    def normal(self) -> tuple[Any, Any, Any]:
        """The unit vector."""
        return self.normal_x, self.normal_y, self.normal_z

    @property
    def point(self) -> tuple[Any, Any, Any]:
        """The contact point."""
        return self.point_x, self.point_y, self.point_z


@dataclass(frozen=True)
class SpatialShape(RoundedShape):
    """A core, a point or a segment or a box, padded by a radius.

    The gap to a sphere is the distance of its centre from the core, less both radii. Where the nearest point of the
    core jumps from its inside to an end, the formula is smoothed over about `smoothing`, so that it is infinitely often
    differentiable wherever the sphere's centre is outside the core. There is one contact point, also along flat sides.

    Attributes
    ----------
    radius : float
        Padding of the core, metres.
    """

    dimension: ClassVar[int] = 3
    radius: float

    def gap_to_sphere(
        self,
        radius: float,
        centre: Vector,
        position: Vector,
        rotation: Matrix | None = None,
    ) -> SpatialGap:
        """The gap to a sphere.

        Parameters
        ----------
        radius : float
            Of the sphere, metres.
        centre : three numbers, arrays or expressions
            Of the sphere in the world, metres.
        position : three numbers, arrays or expressions
            Of the body's origin, metres.
        rotation : three rows of three entries, optional
            Of the body; not read where the shape is round.

        Returns
        -------
        SpatialGap
            In the directions of the world; the contact point is relative to the body's origin.
        """
        apart = [c - q for c, q in zip(centre, position, strict=True)]
        core: Vector = (0.0, 0.0, 0.0)
        if not self.is_round:
            if rotation is None:
                raise ObstacleError(f"{type(self).__name__}: its gap needs the rotation of the body.")
            in_frame = self.nearest_of_core(*(inner_product(column, apart) for column in zip(*rotation, strict=True)))
            core = [inner_product(row, in_frame) for row in rotation]
            apart = [d - k for d, k in zip(apart, core, strict=True)]
        length = root(inner_product(apart, apart) + _SMALL_AREA)
        normal = [d / length for d in apart]
        point = [k + self.radius * n for k, n in zip(core, normal, strict=True)]
        return SpatialGap(length - self.radius - radius, *normal, *point)


@dataclass(frozen=True)
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
