"""Parking cases as competitions publish them: the poses of start and goal and polygons, in one line of numbers."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np

from pyrobocop_pyomo.contrib.robots.decomposition import decompose
from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import shapely
from pyrobocop_pyomo.presentation import Presented

# Corners of an outline that are nearer to its hull than this many units of length make it no less convex.
NEARLY_CONVEX = 1e-6
# Obstacles are cut off this far from the start and the goal: no car gets there, and walls without end cost digits.
CUT_OFF = 1000.0


@dataclass(frozen=True)
class ParkingCar:
    """Size and limits of a car that steers with its front wheels: metres, seconds, radians.

    Attributes
    ----------
    wheelbase, front_overhang, rear_overhang, width : float
        From axle to axle, beyond the front axle, beyond the rear axle, across.
    speed, acceleration, steering, steering_rate : float
        Largest sizes, in both directions.
    """

    wheelbase: float = 2.8
    front_overhang: float = 0.96
    rear_overhang: float = 0.929
    width: float = 1.942
    speed: float = 2.5
    acceleration: float = 1.0
    steering: float = 0.75
    steering_rate: float = 0.5

    def __post_init__(self) -> None:
        for name, number in vars(self).items():
            least_is_zero = name in ("front_overhang", "rear_overhang")
            if not (math.isfinite(number) and (number > 0.0 or (least_is_zero and number == 0.0))):
                raise ObstacleError(f"ParkingCar: {name} = {number}; expected a positive number.")
        if not self.steering < 0.5 * math.pi:
            raise ObstacleError(f"ParkingCar: steering = {self.steering}; expected radians below pi / 2.")

    @property
    def length(self) -> float:
        """From its rear end to its front end."""
        return self.rear_overhang + self.wheelbase + self.front_overhang

    @property
    def shape(self) -> Polytope:
        """The car's rectangle in its own frame: origin in the middle of the rear axle, x ahead."""
        middle = 0.5 * self.length - self.rear_overhang
        return Polytope.box(self.length, self.width, center=(middle, 0.0), name="car")


@dataclass(frozen=True, eq=False)
class ParkingCase(Presented):
    """Where a car starts, where it parks, and its obstacles; relative to the place where it starts.

    Attributes
    ----------
    name : str
    origin : (float, float)
        Where the start is in the coordinates of the file.
    start, goal : (3,) array
        x, y and heading of the middle of the rear axle; x and y relative to the origin. The heading at the start is
        between -pi and pi, and the one at the goal at most half a turn from it.
    obstacles : dict of str to list of Polytope
        "obstacle 1", ...: the convex parts of each polygon, relative to the origin. What is farther than a kilometre
        from start and goal is cut off.
    """

    name: str
    origin: tuple[float, float]
    start: Array
    goal: Array
    obstacles: dict[str, list[Polytope]]

    @classmethod
    def read(cls, path: str | Path) -> ParkingCase:
        """Read a file: x, y and heading of start and goal, the number of obstacles, their numbers of corners, corners.

        Parameters
        ----------
        path : str or Path
            Numbers separated by commas, blanks or lines. Headings are in radians, by any number of turns. The corners
            of each polygon follow each other once around it, in either orientation, the first one repeated or not.

        Raises
        ------
        ObstacleError
            When the counts do not fit, something is no number, or an outline is none; with the place.
        OSError
            When the file cannot be read.
        """
        words = [word for word in re.split(r"[\s,;]+", Path(path).read_text(encoding="utf-8-sig")) if word]
        return cls.from_numbers(words, name=Path(path).stem)

    @classmethod
    def from_numbers(cls, numbers: Iterable[str | float], *, name: str = "parking") -> ParkingCase:
        """The same from the numbers of a file, in its order.

        Parameters
        ----------
        numbers : iterable of float or str
            Differences of coordinates are taken in decimals: no digits are lost, however far away the origin is.
        name : str, optional
            For messages, and the name of the model.

        Raises
        ------
        ObstacleError
            As for `read`.
        """
        exact = [_decimal(number, position, name) for position, number in enumerate(numbers, start=1)]
        if len(exact) <= 6:
            raise ObstacleError(
                f"parking case '{name}': {len(exact)} numbers; expected x, y, heading of the start and of the goal, "
                "the number of obstacles, the number of corners of each, and the corners."
            )
        count = _count(exact[6], "the number of obstacles", name, least=0)
        counts = [_count(number, f"the number of corners of obstacle {k}", name, least=1)
                  for k, number in enumerate(exact[7 : 7 + count], start=1)]  # fmt: skip
        wanted = 7 + count + 2 * sum(counts)
        if len(counts) < count or len(exact) != wanted:
            raise ObstacleError(
                f"parking case '{name}': {len(exact)} numbers, but {count} obstacles with {sum(counts)} corners in all "
                f"take {wanted}. Is a line missing, or is there more than one case in the file?"
            )
        x, y = exact[0], exact[1]
        corners = [
            (float(a - x), float(b - y)) for a, b in zip(exact[7 + count :: 2], exact[8 + count :: 2], strict=True)
        ]
        ends = np.cumsum([0, *counts])
        outlines = [np.array(corners[a:b]) for a, b in itertools.pairwise(ends.tolist())]
        heading = math.remainder(float(exact[2]), 2.0 * math.pi)
        turn = math.remainder(float(exact[5]) - float(exact[2]), 2.0 * math.pi)
        goal = np.array([float(exact[3] - x), float(exact[4] - y), heading + turn])
        low, high = np.minimum(goal[:2], 0.0) - CUT_OFF, np.maximum(goal[:2], 0.0) + CUT_OFF
        obstacles = {
            f"obstacle {k}": _parts(outline, f"obstacle {k}", low, high) for k, outline in enumerate(outlines, 1)
        }
        obstacles = {what: parts for what, parts in obstacles.items() if parts}
        return cls(name, (float(x), float(y)), np.array([0.0, 0.0, heading]), goal, obstacles)

    @property
    def parts(self) -> dict[str, Polytope]:
        """All convex parts by name."""
        return {part.name: part for parts in self.obstacles.values() for part in parts}

    def __str__(self) -> str:
        return (
            f"parking case '{self.name}': from ({self.origin[0]:.6g}, {self.origin[1]:.6g}, {self.start[2]:.4g}) by "
            f"({self.goal[0]:.4g}, {self.goal[1]:.4g}), {len(self.obstacles)} obstacles of "
            f"{len(self.parts)} convex parts"
        )


def _decimal(number: str | float, position: int, name: str) -> Decimal:
    try:
        decimal = Decimal(number if isinstance(number, str) else repr(float(number)))
    except (InvalidOperation, ValueError, TypeError):
        decimal = Decimal("nan")
    if not decimal.is_finite():
        raise ObstacleError(f"parking case '{name}': value {position} is {number!r}; expected a finite number.")
    return decimal


def _count(number: Decimal, label: str, name: str, least: int) -> int:
    if number != int(number) or number < least:
        raise ObstacleError(f"parking case '{name}': {label} is {number}; expected a whole number from {least} on.")
    return int(number)


def _parts(outline: Array, name: str, low: Array, high: Array) -> list[Polytope]:
    """Convex parts of an outline within a box; none where it is outside."""
    if (outline.min(axis=0) > high).any() or (outline.max(axis=0) < low).any():
        return []
    if (outline >= low).all() and (outline <= high).all():
        return convex_parts(outline, name)
    area = shapely.make_valid(shapely.Polygon(outline)) if len(outline) > 2 else shapely.MultiPoint(outline).convex_hull
    inside = shapely.intersection(area, shapely.box(*low.tolist(), *high.tolist()))
    pieces = [shapely.get_coordinates(piece) for piece in shapely.get_parts(inside) if not piece.is_empty]
    shapes = [convex_parts(piece, name) for piece in pieces]
    if len(shapes) == 1:
        return shapes[0]
    parts = [part for found in shapes for part in found]
    return [part.named(f"{name}[{k}]") for k, part in enumerate(parts, 1)]


def convex_parts(outline: Sequence[Sequence[float]] | Array, name: str) -> list[Polytope]:
    """Convex shapes that fill an outline: of either orientation, closed or not, convex or not.

    Parameters
    ----------
    outline : (k, 2) array
        Corners once around. Two are a line segment, one is a point.
    name : str
        Parts are called ``name[1]``, ``name[2]``, and so on; a single part is called ``name``.
    """
    points = np.asarray(outline, dtype=float)
    extent = max(float(np.ptp(points, axis=0).max()), 1e-300)
    # Relative: nearer corners would make sides without a direction.
    keep = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1) > 1e-12 * extent
    points = points[keep] if keep.any() else points[:1]
    hull = Polytope.hull(points, name=name, allow_flat=True)
    if hull.is_flat or len(points) == len(hull.covering) == 3:
        return [hull]
    polygon = shapely.Polygon(points)
    if not polygon.is_valid:
        # Sides that touch or cross: what lies inside by the even-odd rule.
        polygon = shapely.make_valid(polygon)
        pieces = [piece for piece in getattr(polygon, "geoms", [polygon]) if piece.area > 0.0]
        polygon = shapely.MultiPolygon([part for piece in pieces for part in getattr(piece, "geoms", [piece])])
    else:
        normals, offsets = hull.halfspaces
        if (points @ normals.T - offsets).max(axis=1).min() >= -NEARLY_CONVEX:
            return [hull]
    return decompose(polygon, name=name)
