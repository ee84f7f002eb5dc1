"""Convex shapes: corners, rays where they are unbounded, and a padding that rounds them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from numbers import Real
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.numerics.rounding import ROUNDING
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.presentation import Presented

from .polyhedra import affine_rank, halfspaces_of
from .polytope_input import corners_of_halfspaces, corners_of_list, read_points
from .poses import Pose


@dataclass(frozen=True, eq=False)
class Polytope(Presented):
    """All points closer than a radius to the convex hull of some corners and rays, in the plane or in space.

    Each corner may be an ellipsoid. Who plans with a shape asks how high it is along normals (`highest`, `lowest`), for
    a box around it, or for a polytope that contains it (`covered`).

    Make one by `box`, `regular_polygon`, `from_vertices`, `from_halfspaces`, `ball`, `capsule`, `cylinder`, `cone`,
    `ellipsoid` or `point`: they check what they are given. The constructor itself checks nothing.

    Attributes
    ----------
    vertices : (v, d) array
        In the plane and bounded: counter-clockwise. Read-only.
    rays : (k, d) array
        Unit directions in which the shape has no end; none (k = 0) for a bounded shape. Read-only.
    radius : float
        Everything closer than this belongs to the shape too; 0 for sharp corners.
    name : str
        What messages call it.
    excess : float
        No point of the shape is farther than this from what it stands for: a cylinder, a cone, occupied cells, all of
        which it contains. Zero for a shape that is exact.
    ellipsoids : (v, d, d) array or None
        Each corner is the image of the unit ball under its matrix, moved to the corner; None for points. Read-only.
    """

    vertices: np.ndarray
    rays: np.ndarray = None  # type: ignore[assignment]  # so that Polytope(points) is answered below
    radius: float = 0.0
    name: str = "polytope"
    excess: float = 0.0
    ellipsoids: np.ndarray | None = None

    def __post_init__(self) -> None:
        if not (isinstance(self.vertices, np.ndarray) and isinstance(self.rays, np.ndarray)):
            raise ObstacleError(
                "Polytope(...) checks nothing and is no way to make one. Write rcp.Polytope.from_vertices(corners), "
                "rcp.Polytope.hull(points), rcp.Polytope.box(length, width), or another of its class methods."
            )
        self.vertices.setflags(write=False)
        self.rays.setflags(write=False)
        if self.ellipsoids is not None:
            self.ellipsoids.setflags(write=False)

    @classmethod
    def from_vertices(
        cls, vertices: Any, *, radius: float = 0.0, allow_flat: bool = False, name: str = "polytope"
    ) -> Polytope:
        """Shape with the given corners: in the plane an outline, in either direction; in space in any order.

        Parameters
        ----------
        vertices : (v, d) array_like
            Repeated points and points between corners are dropped with a warning in the log.
        radius : float, optional
            Padding.
        allow_flat : bool, optional
            Accept a point, a segment, or in space a flat polygon.

        Raises
        ------
        ObstacleError
            For corners that are not finite or span no volume, and for an outline that crosses itself or is not
            convex: its hull would silently fill free space. `decompose` cuts it into convex parts.
        """
        points = read_points(vertices, name)
        return cls._of_points(points, radius, name, allow_flat=allow_flat, ordered=True)

    @classmethod
    def hull(cls, points: Any, *, radius: float = 0.0, allow_flat: bool = False, name: str = "polytope") -> Polytope:
        """Convex hull of points in any order; notches between them are filled."""
        return cls._of_points(read_points(points, name, "points"), radius, name, allow_flat=allow_flat, ordered=False)

    @classmethod
    def _of_points(cls, points: np.ndarray, radius: float, name: str, *, allow_flat: bool, ordered: bool) -> Polytope:
        if len(points) == 0:
            raise ObstacleError(f"'{name}': there are no points. Give at least one.")
        corners = corners_of_list(points, allow_flat=allow_flat, ordered=ordered, name=name)
        return cls(corners, np.zeros((0, points.shape[1])), _checked_radius(radius, name), name)

    @classmethod
    def from_halfspaces(
        cls, normals: Any, offsets: Any, *, bounded: bool = True, radius: float = 0.0, name: str = "polytope"
    ) -> Polytope:
        """The set ``{y : normals @ y <= offsets}``: normals point outwards.

        Parameters
        ----------
        normals, offsets : (m, d) and (m,) array_like
            Rows of any length but zero. Rows that cut nothing off do not count.
        bounded : bool, optional
            False accepts a set without end: a half-space, a wedge, a slab.
        radius : float, optional
            Padding.

        Raises
        ------
        ObstacleError
            If the set is empty, flat, or has no end though it should: a sign or a row is wrong.
        """
        vertices, rays = corners_of_halfspaces(normals, offsets, bounded=bounded, name=name)
        if len(rays):
            return cls(vertices, rays, _checked_radius(radius, name), name)
        return cls._of_points(vertices, radius, name, allow_flat=False, ordered=False)

    @classmethod
    def box(cls, *sides: float, center: Sequence[float] | None = None, name: str = "box") -> Polytope:
        """Box with the given full side lengths (two or three), its sides along the axes."""
        numbers = all(isinstance(side, Real) for side in sides)
        lengths = np.array(sides if numbers else (), dtype=float)
        if len(lengths) not in (2, 3) or not np.isfinite(lengths).all() or lengths.min() <= 0.0:
            raise ObstacleError(f"'{name}': a box has 2 or 3 sides of positive length; given: {sides}.")
        # Counter-clockwise in the plane, as for every shape.
        signs = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
        if len(sides) == 3:
            signs = np.vstack([np.column_stack([signs, np.full(4, z)]) for z in (-1.0, 1.0)])
        middle = _checked_position((0.0,) * len(sides) if center is None else center, name, len(sides))
        return cls(middle + 0.5 * signs * lengths, np.zeros((0, len(sides))), 0.0, name)

    @classmethod
    def regular_polygon(
        cls, corners: int, circumradius: float, center: Sequence[float] = (0.0, 0.0), *, name: str = "polygon"
    ) -> Polytope:
        """Polygon with equal sides and its first corner on the positive x axis of its centre."""
        if not (math.isfinite(circumradius) and circumradius > 0.0):
            raise ObstacleError(f"'{name}': circumradius {circumradius}; expected a positive length.")
        ring = circumradius * _on_circle(corners, name, "corners")
        return cls(_checked_position(center, name, 2) + ring, np.zeros((0, 2)), 0.0, name)

    @classmethod
    def point(cls, position: Sequence[float], *, name: str = "point") -> Polytope:
        """A single point."""
        place = _checked_position(position, name)
        return cls(place[None, :], np.zeros((0, len(place))), 0.0, name)

    @classmethod
    def ball(cls, radius: float, center: Sequence[float] = (0.0, 0.0), *, name: str = "ball") -> Polytope:
        """A disc in the plane, a ball in space: as many dimensions as the centre has."""
        return replace(cls.point(center, name=name), radius=_checked_radius(radius, name))

    @classmethod
    def capsule(cls, start: Sequence[float], end: Sequence[float], radius: float, *, name: str = "capsule") -> Polytope:
        """All points closer than a radius to the segment from start to end."""
        return cls.from_vertices([start, end], radius=radius, allow_flat=True, name=name)

    @classmethod
    def cylinder(
        cls,
        radius: float,
        height: float,
        center: Sequence[float] = (0.0, 0.0, 0.0),
        axis: Sequence[float] = (0.0, 0.0, 1.0),
        *,
        sides: int = 16,
        name: str = "cylinder",
    ) -> Polytope:
        """A prism around a cylinder in space; `excess` is by how much it is larger, 2 % of the radius with 16 sides.

        Parameters
        ----------
        radius, height : float
        center : (x, y, z)
            Middle of the cylinder.
        axis : (x, y, z)
            Its direction, of any length. Another orientation: ``shape.placed(pose)``.
        sides : int
            Of the prism, which has twice as many corners.

        Raises
        ------
        ObstacleError
            For lengths that are not positive, or fewer than 3 sides.
        """
        ring, excess = _around_circle(radius, height, sides, name)
        middle, half = _checked_position(center, name, 3), np.array([0.0, 0.0, 0.5 * height])
        turned = np.vstack([ring - half, ring + half]) @ _frame_along(axis, name).T
        return replace(cls.hull(middle + turned, name=name), excess=excess)

    @classmethod
    def cone(
        cls,
        radius: float,
        height: float,
        center: Sequence[float] = (0.0, 0.0, 0.0),
        axis: Sequence[float] = (0.0, 0.0, 1.0),
        *,
        sides: int = 16,
        name: str = "cone",
    ) -> Polytope:
        """A pyramid around a cone; like `cylinder`, but `center` is the middle of its base."""
        ring, excess = _around_circle(radius, height, sides, name)
        corners = np.vstack([ring, [0.0, 0.0, height]])
        base = _checked_position(center, name, 3)
        return replace(cls.hull(base + corners @ _frame_along(axis, name).T, name=name), excess=excess)

    @classmethod
    def ellipsoid(
        cls, semi_axes: Sequence[float], center: Sequence[float] | None = None, *, name: str = "ellipsoid"
    ) -> Polytope:
        """An ellipse or an ellipsoid along the axes, exact.

        Parameters
        ----------
        semi_axes : two or three lengths
            Halves of its widths. Another orientation: ``shape.placed(pose)``.
        center : position, optional
            The origin by default.

        Raises
        ------
        ObstacleError
            For lengths that are not positive.
        """
        lengths = np.array(semi_axes, dtype=float)
        if lengths.shape not in ((2,), (3,)) or not np.isfinite(lengths).all() or lengths.min() <= 0.0:
            raise ObstacleError(f"'{name}': semi-axes {semi_axes!r}; expected two or three positive lengths.")
        dimension = len(lengths)
        middle = _checked_position((0.0,) * dimension if center is None else center, name, dimension)
        return replace(cls.point(middle.tolist(), name=name), ellipsoids=np.diag(lengths)[None])

    def padded(self, radius: float) -> Polytope:
        """The shape grown by a radius on all sides, its corners rounded."""
        return replace(self, radius=self.radius + _checked_radius(radius, self.name))

    def named(self, name: str) -> Polytope:
        """The same shape under another name."""
        return replace(self, name=name)

    def placed(self, pose: Pose) -> Polytope:
        """The shape in the world at a pose of numbers (of expressions: at their current values)."""
        if pose.dimension != self.dimension:
            raise ObstacleError(
                f"'{self.name}' has {self.dimension} dimensions and its pose {pose.dimension}. "
                "Use planar_pose in the plane and spatial_pose in space."
            )
        return self.swept([pose.numbers()])

    def swept(self, poses: Sequence[tuple[np.ndarray, np.ndarray]]) -> Polytope:
        """The convex hull of the shape at several poses, given by rotations (d, d) and translations (d,)."""
        turned = None
        if self.ellipsoids is not None:
            turned = np.vstack([rotation @ self.ellipsoids for rotation, _ in poses])
        return replace(
            self,
            vertices=np.vstack([self.vertices @ rotation.T + translation for rotation, translation in poses]),
            rays=np.vstack([self.rays @ rotation.T for rotation, _ in poses]),
            ellipsoids=turned,
        )

    def highest(self, normals: np.ndarray) -> np.ndarray:
        """How high the shape reaches along each of the unit vectors (k, d), its padding included, rays apart: (k,)."""
        heights = normals @ self.vertices.T
        if self.ellipsoids is not None:
            heights = heights + extents(normals, self.ellipsoids)
        return np.asarray(heights.max(axis=1) + self.radius)

    def lowest(self, normals: np.ndarray) -> np.ndarray:
        """How low it reaches: (k,)."""
        return -self.highest(-normals)

    @cached_property
    def bounding_box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner (d,) of the box around the shape, its padding included, rays apart."""
        axes = np.eye(self.dimension)
        return self.lowest(axes), self.highest(axes)

    @cached_property
    def covered(self) -> Polytope:
        """A polytope that contains the shape, larger by `excess`; the shape itself where its corners are points.

        It is the image of a polytope around the unit ball, whose corners are at most ``share`` from the centre. A
        corner ``share u`` goes to a point that is ``(share - 1) |A u|`` from the point ``A u`` of the ellipsoid.
        """
        if self.ellipsoids is None:
            return self
        unit = on_unit_ball(self.dimension, 16 if self.dimension == 2 else 50)
        unit = unit * (1.0 + ROUNDING) / float(-scipy.spatial.ConvexHull(unit).equations[:, -1].max())
        share = float(np.linalg.norm(unit, axis=1).max())
        around = Polytope.hull(self.images(unit), radius=self.radius, name=self.name)
        return replace(around, excess=(share - 1.0) * float(np.linalg.norm(self.ellipsoids, 2, axis=(1, 2)).max()))

    def images(self, unit: np.ndarray) -> np.ndarray:
        """Points (k, d) of the ellipsoids that points of the unit ball stand for; corners where they are points."""
        if self.ellipsoids is None:
            return self.vertices
        return np.asarray(self.vertices[:, None] + unit @ self.ellipsoids.swapaxes(1, 2)).reshape(-1, self.dimension)

    @property
    def covering(self) -> np.ndarray:
        """Points (k, d) whose hull contains the shape, padding and rays apart: the corners, where these are points."""
        return self.covered.vertices

    @property
    def corners(self) -> list[tuple[list[float], np.ndarray | None]]:
        """What a formulation needs of each corner: its place, and its ellipsoid, if it is one."""
        ellipsoids = [None] * len(self.vertices) if self.ellipsoids is None else list(self.ellipsoids)
        return list(zip(self.vertices.tolist(), ellipsoids, strict=True))

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return int(self.vertices.shape[1])

    @property
    def is_bounded(self) -> bool:
        """Whether the shape has no rays."""
        return len(self.rays) == 0

    @cached_property
    def is_flat(self) -> bool:
        """Whether the corners, taken as points, are a point, on a segment, or in space on a flat polygon."""
        return affine_rank(self.vertices, self.rays) < self.dimension

    @cached_property
    def halfspaces(self) -> tuple[np.ndarray, np.ndarray]:
        """``(A, b)`` with unit rows: the shape without its padding is ``{y : A y <= b}``, each row a facet.

        Raises
        ------
        ObstacleError
            If the shape is flat: it has no facets.
        """
        if self.is_flat:
            raise ObstacleError(
                f"'{self.name}' is flat and has no half-spaces. Use a formulation that works "
                "with corners, such as 'plane', or give the shape a thickness."
            )
        normals, offsets = halfspaces_of(self.vertices, self.rays)
        normals.setflags(write=False)
        offsets.setflags(write=False)
        return normals, offsets

    @property
    def center(self) -> np.ndarray:
        """Mean of the corners, (d,)."""
        return self.vertices.mean(axis=0)

    @property
    def lever(self) -> float:
        """No point is farther from the frame's origin, padding apart, and no ray is longer."""
        lengths = np.linalg.norm(self.vertices, axis=1)
        if self.ellipsoids is not None:
            lengths = lengths + np.linalg.norm(self.ellipsoids, 2, axis=(1, 2))
        return float(np.append(lengths, np.linalg.norm(self.rays, axis=1)).max())

    @property
    def reach(self) -> float:
        """No point of the shape is farther from its frame's origin; infinite for a shape with rays."""
        return self.lever + self.radius if self.is_bounded else math.inf

    def __str__(self) -> str:
        what = "corner" if self.ellipsoids is None else "ellipsoid"
        parts = [f"{len(self.vertices)} {what}{'s' if len(self.vertices) != 1 else ''}"]
        if not self.is_bounded:
            parts.append(f"{len(self.rays)} ray{'s' if len(self.rays) != 1 else ''}")
        if self.radius > 0.0:
            parts.append(f"radius {self.radius:g}")
        return f"{self.name}: {', '.join(parts)} in {self.dimension} dimensions"


def _checked_radius(radius: float, name: str) -> float:
    if not (isinstance(radius, Real) and math.isfinite(radius) and radius >= 0.0):
        raise ObstacleError(f"'{name}': its radius is {radius!r}; a padding is a finite length that is not negative.")
    return float(radius)


def _checked_position(position: Sequence[float], name: str, dimension: int | None = None) -> np.ndarray:
    place = read_points([position], name, "positions")[0]
    if dimension is not None and len(place) != dimension:
        raise ObstacleError(f"'{name}': the position has {len(place)} coordinates; expected {dimension}.")
    return place


def _around_circle(radius: float, height: float, sides: int, name: str) -> tuple[np.ndarray, float]:
    """Corners (sides, 3) of a regular polygon around a circle, the base of a shape of some height, and its excess.

    Flat sides touch the round ones along lines: the corners around a radius r are at ``r / cos(pi / sides)``.
    """
    if not (math.isfinite(radius) and math.isfinite(height)) or min(radius, height) <= 0.0:
        raise ObstacleError(f"'{name}': radius {radius}, height {height}; expected positive lengths.")
    corners = _on_circle(sides, name, "sides")
    share = (1.0 + ROUNDING) / math.cos(math.pi / sides)
    return radius * share * np.column_stack([corners, np.zeros(sides)]), radius * (share - 1.0)


def _on_circle(corners: int, name: str, label: str) -> np.ndarray:
    """Corners (k, 2) of a regular polygon in the unit circle, the first one on the x axis."""
    if not isinstance(corners, (int, np.integer)) or corners < 3:
        raise ObstacleError(f"'{name}': {corners!r} {label}; expected a whole number, 3 or more.")
    return on_unit_ball(2, corners)


def extents(normals: np.ndarray, ellipsoids: np.ndarray) -> np.ndarray:
    """How far ellipsoids (..., v, d, d) reach from their middles along vectors (..., d), shape (..., v)."""
    return np.asarray(np.linalg.norm(np.einsum("...d,...vdc->...vc", normals, ellipsoids), axis=-1))


def on_unit_ball(dimension: int, count: int) -> np.ndarray:
    """So many points (count, d), evenly over the unit circle from the x axis on, or on a spiral on a sphere."""
    if dimension == 2:
        turns = 2.0 * math.pi * np.arange(count) / count
        return np.column_stack([np.cos(turns), np.sin(turns)])
    steps = np.arange(count) + 0.5
    spiral, heights = math.pi * (1.0 + math.sqrt(5.0)) * steps, 1.0 - 2.0 * steps / count
    widths = np.sqrt(1.0 - heights**2)
    return np.column_stack([widths * np.cos(spiral), widths * np.sin(spiral), heights])


def _frame_along(axis: Sequence[float], name: str) -> np.ndarray:
    """A rotation (3, 3) that turns the z axis into a direction; the identity for the z axis itself."""
    vector = np.array(axis, dtype=float)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise ObstacleError(f"'{name}': its axis is {axis!r}; expected three numbers, not all zero.")
    z = vector / np.linalg.norm(vector)
    least = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.array([1.0, 0.0, 0.0]) if abs(z[2]) == 1.0 else np.cross(least, z)
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
