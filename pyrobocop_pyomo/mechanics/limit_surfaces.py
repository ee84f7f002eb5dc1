"""Friction of what slides in several directions at once: the ellipsoid of forces that it can bear."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, ClassVar

from pyomo.core.expr import cos, sin

from pyrobocop_pyomo.complementarity import complements
from pyrobocop_pyomo.errors import DeclarationError
from pyrobocop_pyomo.phases.declarations import UNBOUNDED

from .planar_bodies import check_positive
from .signal_laws import NONNEGATIVE, Moment, Quantity, SignalLaw, Unknown

Place = tuple[Any, Any]


@dataclass(frozen=True)
class LimitSurface:
    """The wrenches that friction between a flat body and a table can bear, as an ellipsoid.

    ``(f_x^2 + f_y^2) / force^2 + m^2 / moment^2 = 1``, with the moment about the centre of friction. A body that is
    pushed slowly moves along the normal of the surface: ``v = f / force^2``, ``omega = m / moment^2``, up to a
    factor that a quasi-static model leaves free.

    Attributes
    ----------
    force : float
        Largest force without a moment, newtons.
    moment : float
        Largest moment without a force, newton metres.
    centre : (x, y)
        Centre of friction in the frame of the body, metres.

    Examples
    --------
    >>> import pyrobocop_pyomo as rcp
    >>> table = rcp.mechanics.LimitSurface.of_polygon([(0, 0), (0.3, 0), (0.3, 0.1), (0, 0.1)], mass=1.0, friction=0.4)
    >>> [round(x, 12) for x in table.centre]
    [0.15, 0.05]
    >>> round(table.lever, 4)
    0.0823

    References
    ----------
    Lynch, Maekawa & Tanie, Manipulation and active sensing by pushing using tactile feedback, IROS 1992,
    doi:10.1109/IROS.1992.587370; Howe & Cutkosky, Practical force-motion models for sliding manipulation, Int. J.
    Robotics Research 15 (1996), doi:10.1177/027836499601500603
    """

    force: float
    moment: float
    centre: Place = (0.0, 0.0)

    def __post_init__(self) -> None:
        check_positive(self, "force", "moment")

    @classmethod
    def of_polygon(cls, corners: Sequence[Place], mass: float, friction: float, gravity: float = 9.81) -> LimitSurface:
        """Of a flat body that presses evenly on the table with the whole of a polygon.

        The moment is ``friction mass gravity`` times the mean distance of the polygon's points from their centroid.

        Parameters
        ----------
        corners : sequence of (x, y)
            In order, either way around, in the frame of the body, metres; the polygon need not be convex.
        mass : float
            Kilograms.
        friction : float
            Coefficient of friction with the table.
        gravity : float
            Metres per second squared.

        Raises
        ------
        DeclarationError
            When there are fewer than three corners, they have no area, or a number is not positive.
        """
        centre, distance = centroid_and_mean_distance(corners)
        return cls._evenly(distance, centre, mass, friction, gravity)

    @classmethod
    def of_disc(cls, radius: float, mass: float, friction: float, gravity: float = 9.81) -> LimitSurface:
        """Of a disc around the origin that presses evenly on the table: the mean distance is two thirds of the radius.

        Parameters
        ----------
        radius : float
            Metres.
        mass, friction, gravity : float
            As of a polygon.
        """
        return cls._evenly(2 / 3 * radius, (0.0, 0.0), mass, friction, gravity)

    @classmethod
    def _evenly(cls, distance: float, centre: Place, mass: float, friction: float, gravity: float) -> LimitSurface:
        for name, given in (("mass", mass), ("friction", friction), ("gravity", gravity), ("distance", distance)):
            if not (math.isfinite(given) and given > 0):
                raise DeclarationError(f"{cls.__name__}: {name} = {given!r}; expected a positive number.")
        force = friction * mass * gravity
        return cls(force, force * distance, centre)

    @property
    def lever(self) -> float:
        """Moment over force, metres: the lever arm of friction."""
        return self.moment / self.force

    def load(self, f_x: Any, f_y: Any, moment: Any) -> Any:
        """Square of how much of the surface a wrench uses: below one it holds, at one it slides.

        Parameters
        ----------
        f_x, f_y, moment : number or expression
            In the frame of the body, the moment about the centre of friction: newtons, newton metres.
        """
        return (f_x**2 + f_y**2) / self.force**2 + moment**2 / self.moment**2

    def twist(self, f_x: Any, f_y: Any, moment: Any) -> tuple[Any, Any, Any]:
        """Velocity of the centre of friction and rotation under a wrench, in the frame of the body.

        Parameters
        ----------
        f_x, f_y, moment : number or expression
            As of `load`.
        """
        return f_x / self.force**2, f_y / self.force**2, moment / self.moment**2

    def velocity(self, theta: Any, contact: Place, force: Place) -> tuple[Any, Any, Any]:
        """Rates of the pose of the body in the world under a force at a contact point.

        Plain arithmetic: numbers give numbers, Pyomo variables give expressions.

        Parameters
        ----------
        theta : float or expression
            Rotation of the body, radians.
        contact : (x, y)
            Contact point in the frame of the body, metres.
        force : (f_x, f_y)
            Contact force in the frame of the body, newtons.

        Returns
        -------
        (v_x, v_y, omega) : tuple
            Of the origin of the body's frame.
        """
        c_x, c_y = self.centre
        f_x, f_y = force
        body_x, body_y, omega = self.twist(f_x, f_y, (contact[0] - c_x) * f_y - (contact[1] - c_y) * f_x)
        if c_x or c_y:
            body_x, body_y = body_x + omega * c_y, body_y - omega * c_x
        return cos(theta) * body_x - sin(theta) * body_y, sin(theta) * body_x + cos(theta) * body_y, omega


@dataclass(frozen=True)
class SlidingFriction(SignalLaw):
    """Coulomb friction in several directions at once, by the principle of maximal dissipation.

    With the velocities ``v_i`` and the strengths ``c_i``, the forces are ``F_i = normal c_i d_i``, where ``d`` lies in
    the unit ball, and points against the motion wherever there is one::

        c_i v_i + rate d_i = 0,    0 <= rate _|_ 1 - sum_i d_i^2 >= 0

    Two equal coefficients make the round cone of friction in space; ``(c, c, c lever)``, with two velocities and a
    rotation, the ellipsoidal limit surface of a flat body. The signal is the rate, ``sqrt(sum_i (c_i v_i)^2)``: zero
    while it sticks, and times the normal force the power that friction takes away. The forces are ``<name>_1``,
    ``<name>_2``, ...

    Attributes
    ----------
    slip : tuple of rules
        Velocities of what the force acts on relative to what it rubs on, metres or radians per second.
    normal : number or rule
        Normal force, newtons; it must not be negative.
    coefficients : tuple of numbers or rules
        One for each velocity: without a unit, or metres for a rotation.

    Raises
    ------
    DeclarationError
        When there are not as many coefficients as velocities, or one is not positive.

    References
    ----------
    Stewart, Rigid-Body Dynamics with Friction and Impact, SIAM Review 42 (2000), doi:10.1137/S0036144599360110;
    Goyal, Ruina & Papadopoulos, Planar sliding with dry friction, Wear 143 (1991), doi:10.1016/0043-1648(91)90104-3
    """

    positive: ClassVar = ("coefficients",)
    nonnegative: ClassVar = ("normal",)

    slip: tuple[Quantity, ...]
    normal: Quantity
    coefficients: tuple[Quantity, ...]

    def __post_init__(self) -> None:
        for name in ("slip", "coefficients"):
            given = getattr(self, name)
            if not isinstance(given, (tuple, list)):
                raise DeclarationError(f"{self._what}: {name} = {given!r}; expected a tuple, one entry per direction.")
            object.__setattr__(self, name, tuple(given))
        super().__post_init__()
        if len(self.slip) != len(self.coefficients) or not self.slip:
            raise DeclarationError(
                f"{self._what}: {len(self.slip)} velocities and {len(self.coefficients)} coefficients; expected one of "
                "each per direction."
            )

    @property
    def _directions(self) -> range:
        return range(len(self.slip))

    def unknowns(self) -> Mapping[str, Unknown]:
        """The rate, the forces, and the directions ``<name>_direction_1``, ``<name>_direction_2``, ..."""
        found = {"": Unknown(NONNEGATIVE, lambda at: at.ask("coefficients")[0] * at.ask("slip")[0])}
        for i in self._directions:
            found[f"{i + 1}"] = Unknown(UNBOUNDED, partial(_strength_along, i))
            found[f"direction_{i + 1}"] = Unknown((-1.0, 1.0), lambda at: 1.0)
        return found

    def equations(self, at: Moment) -> Any:
        """Force and direction, direction and motion."""
        slip, coefficients, normal = at.ask("slip"), at.ask("coefficients"), at.ask("normal")
        rows = {}
        for i in self._directions:
            direction = at[f"direction_{i + 1}"]
            rows[f"force_{i + 1}"] = at[f"{i + 1}"] == normal * coefficients[i] * direction
            rows[f"motion_{i + 1}"] = coefficients[i] * slip[i] + at.signal * direction == 0
        return rows

    def pairs(self, at: Moment) -> Any:
        """Motion only at full strength."""
        return complements(at.signal >= 0, 1 - sum(at[f"direction_{i + 1}"] ** 2 for i in self._directions) >= 0)

    def start(self, asked: Callable[[str], Any]) -> Mapping[str, float]:
        """Full strength against the motion."""
        moving = [c * v for c, v in zip(asked("coefficients"), asked("slip"), strict=True)]
        rate = math.hypot(*moving)
        found = {"": rate}
        for i, (coefficient, speed) in enumerate(zip(asked("coefficients"), moving, strict=True), start=1):
            found[f"direction_{i}"] = -speed / rate if rate else 0.0
            found[f"{i}"] = asked("normal") * coefficient * found[f"direction_{i}"]
        return found


def _strength_along(i: int, at: Moment) -> Any:
    return at.ask("normal") * at.ask("coefficients")[i]


def centroid_and_mean_distance(corners: Sequence[Place]) -> tuple[tuple[float, float], float]:
    """Centroid of a polygon, and the mean distance of its points from it: a closed formula per edge.

    Parameters
    ----------
    corners : sequence of (x, y)
        In order, either way around.

    Raises
    ------
    DeclarationError
        When there are fewer than three corners, or they have no area.
    """
    points = [(float(x), float(y)) for x, y in corners]
    edges = [*pairwise(points), (points[-1], points[0])] if len(points) > 2 else []
    twice = [a[0] * b[1] - a[1] * b[0] for a, b in edges]
    size = max((abs(x) for point in points for x in point), default=0.0)
    if not abs(sum(twice)) > 1e-12 * size**2:
        raise DeclarationError(
            f"polygon of {len(points)} corners {points}: it has no area. Give three or more corners in order, metres."
        )
    centre = tuple(
        sum(cross * (a[k] + b[k]) for cross, (a, b) in zip(twice, edges, strict=True)) / (3 * sum(twice))
        for k in range(2)
    )
    total = sum(_distance_over_triangle(*((p[0] - centre[0], p[1] - centre[1]) for p in edge)) for edge in edges)
    return (centre[0], centre[1]), abs(2 * total / sum(twice))


def _distance_over_triangle(first: tuple[float, float], last: tuple[float, float]) -> float:
    """Integral of the distance from the origin over the triangle of origin and edge, negative for clockwise edges."""
    length = math.dist(first, last)
    cross = first[0] * last[1] - first[1] * last[0]
    if length == 0 or cross == 0:
        return 0.0
    # In polar coordinates around the foot of the perpendicular, at the height h: h^3 / 3 times the integral of sec^3.
    height = abs(cross) / length
    direction = (last[0] - first[0]) / length, (last[1] - first[1]) / length

    def up_to(point: tuple[float, float]) -> float:
        tangent = (point[0] * direction[0] + point[1] * direction[1]) / height
        return tangent * math.hypot(1, tangent) + math.asinh(tangent)

    return math.copysign(height**3 / 6 * (up_to(last) - up_to(first)), cross)
