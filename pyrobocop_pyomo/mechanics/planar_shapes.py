"""Shapes in the plane and their smooth gaps to a disc: plain arithmetic for numbers, arrays and Pyomo expressions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from .shapes import RoundedShape, cosine, root, sine

# Added to squared lengths before their root is taken, square metres: a length of zero would have no derivative.
_SMALL_AREA = 1e-6


class PlanarGap(NamedTuple):
    """How a disc stands to a body: numbers, arrays or expressions, in one frame.

    Attributes
    ----------
    gap : number or expression
        Distance of the surfaces, metres; negative where they overlap.
    normal_x, normal_y : number or expression
        Unit vector from the body to the disc.
    point_x, point_y : number or expression
        From the body's origin to the point of its surface that is nearest to the disc, metres.
    """

    gap: Any
    normal_x: Any
    normal_y: Any
    point_x: Any
    point_y: Any


@dataclass(frozen=True)
class PlanarShape(RoundedShape):
    """A core, a point or a segment or a rectangle, padded by a radius.

    The gap to a disc is the distance of its centre from the core, less both radii. Where the nearest point of the core
    jumps from its inside to an end, the formula is smoothed over about `smoothing`, and so it is infinitely often
    differentiable wherever the disc's centre is outside the core. There is one contact point, also along flat sides.

    Attributes
    ----------
    radius : float
        Padding of the core, metres.
    """

    dimension: ClassVar[int] = 2
    radius: float

    def gap_to_disc(
        self, disc_radius: float, x: Any, y: Any, pose: tuple[Any, Any, Any] = (0.0, 0.0, 0.0)
    ) -> PlanarGap:
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
        PlanarGap
            In the directions of the world; the contact point is relative to the body's origin.
        """
        q_x, q_y, theta = pose
        s, c = sine(theta), cosine(theta)
        d_x, d_y = x - q_x, y - q_y
        along, across = c * d_x + s * d_y, c * d_y - s * d_x
        core_along, core_across = self.nearest_of_core(along, across)
        n_x, n_y = along - core_along, across - core_across
        length = root(n_x**2 + n_y**2 + _SMALL_AREA)
        n_x, n_y = n_x / length, n_y / length
        p_x, p_y = core_along + self.radius * n_x, core_across + self.radius * n_y
        return PlanarGap(
            length - self.radius - disc_radius,
            c * n_x - s * n_y,
            s * n_x + c * n_y,
            c * p_x - s * p_y,
            s * p_x + c * p_y,
        )


@dataclass(frozen=True)
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
