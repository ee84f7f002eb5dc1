"""Car kinematics: with constant steering, the middle of the rear axle follows an arc of a circle; a trailer follows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.numerics import Array, BoolArray
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE


@dataclass(frozen=True, eq=False)
class Trailer:
    """A trailer with one axle, which does not move along itself; on a hitch that is fixed to the car.

    Its angle is its heading less the heading of the car.

    Attributes
    ----------
    shape : Polytope
        In its own frame: the origin in the middle of its axle, x ahead, towards the hitch.
    hitch : float
        Where the hitch is on the car's x axis: 0 on the rear axle, negative behind.
    length : float
        From the hitch to the axle of the trailer.
    limit : float
        Largest angle, to either side; radians.
    """

    shape: Polytope
    hitch: float
    length: float
    limit: float

    def turned(self, angles: Array, lengths: Array, curvatures: Array) -> Array:
        """Angles after the car has followed one arc each (negative length: backwards); exact, and arrays broadcast.

        By half an angle the equation is linear: for u = (cos(angle / 2), sin(angle / 2)) times any number, du/ds = M u
        along the arc, with a matrix M whose square is a multiple of the unit matrix.
        """
        pull, swing = -1.0 / self.length, self.hitch * curvatures / self.length
        half = 0.5 * lengths
        grown = half * np.sqrt(pull**2 - curvatures**2 + swing**2 + 0j)
        cosine, sine = np.cos(0.5 * angles), np.sin(0.5 * angles)
        rates = (
            half * ((curvatures + swing) * sine - pull * cosine),
            half * ((swing - curvatures) * cosine + pull * sine),
        )
        same = np.cosh(grown).real
        # There sinh(x) / x is 1 in floating point.
        tiny = np.abs(grown) < NEGLIGIBLE
        other = np.where(tiny, 1.0, np.sinh(grown) / np.where(tiny, 1.0, grown)).real
        along = same + other * (cosine * rates[0] + sine * rates[1])
        across = other * (cosine * rates[1] - sine * rates[0])
        return np.asarray(angles + 2.0 * np.arctan2(across, along))

    def poses(self, poses: Array) -> Array:
        """x, y and heading of the trailer, ``(..., 3)``, from the pose of the car and the angle, ``(..., 4)``."""
        x, y, heading, angle = np.moveaxis(poses, -1, 0)
        own = heading + angle
        return np.stack([
            x + self.hitch * np.cos(heading) - self.length * np.cos(own),
            y + self.hitch * np.sin(heading) - self.length * np.sin(own), own,
        ], -1)  # fmt: skip

    def velocities(self, angles: Array, ahead: Array, turns: Array) -> tuple[Array, Array]:
        """Velocity along its heading and turn of the trailer, from velocity and turn of the car."""
        cosine, sine, aside = np.cos(angles), np.sin(angles), self.hitch * turns
        return ahead * cosine + aside * sine, (aside * cosine - ahead * sine) / self.length

    def are_within(self, poses: Array) -> BoolArray:
        """Whether angles are within the limit, ``(...)`` from ``(..., 4)``."""
        return np.asarray(np.abs(poses[..., 3]) <= self.limit + 1e-9)

    def as_arcs(self, curvatures: Array, spacings: Array) -> tuple[Array, Array]:
        """Curvatures and lengths of arcs that deviate from their chords at least as much as the trailer does.

        While the car follows an arc, the trailer's axle drives at most m = 1 + abs(hitch * curvature) times as far, and
        its heading turns by at most m / length per length of the car. The rates of both along the arc are at most
        m (abs(curvature) + m / length), over the length for the turn.
        """
        farther = 1.0 + abs(self.hitch) * np.abs(curvatures)
        return np.abs(curvatures) + 2.0 / self.length, farther * spacings


def follow_arc(poses: Array, lengths: Array, curvatures: Array, trailer: Trailer | None = None) -> Array:
    """Poses (x, y, heading) after one arc each (negative length: backwards); exact, and arrays broadcast.

    Parameters
    ----------
    poses : (..., 3) array, or (..., 4) array with a trailer: its angle last
    lengths, curvatures : (...) arrays
        Curvature is positive to the left, ``tan(steering) / wheelbase``.
    trailer : Trailer, optional
    """
    return follow_arcs(poses, lengths[..., None], curvatures[..., None], trailer)[..., 1, :]


def follow_arcs(poses: Array, lengths: Array, curvatures: Array, trailer: Trailer | None = None) -> Array:
    """Poses along several arcs in a row, the first included: ``(..., s + 1, 3)`` from ``(..., 3)`` and ``(..., s)``.

    With a trailer, poses have its angle as a fourth number.
    """
    half = 0.5 * lengths * curvatures
    chord = lengths * np.sinc(half / np.pi)
    shape = np.broadcast_shapes(poses.shape[:-1], chord.shape[:-1])
    start = np.broadcast_to(poses[..., None, :3], (*shape, 1, 3))
    after = start[..., 2] + 2.0 * np.cumsum(half, axis=-1)
    middle = after - half
    steps = np.stack([chord * np.cos(middle), chord * np.sin(middle)], -1)
    ends = np.concatenate([start[..., :2] + np.cumsum(steps, axis=-2), after[..., None]], -1)
    along = np.concatenate([start, ends], -2)
    if trailer is None:
        return along
    angles = [np.broadcast_to(poses[..., 3], shape)]
    for k in range(chord.shape[-1]):
        angles.append(np.broadcast_to(trailer.turned(angles[-1], lengths[..., k], curvatures[..., k]), shape))
    return np.concatenate([along, np.stack(angles, -1)[..., None]], -1)


def placed(poses: Array, points: Array) -> Array:
    """Points ``(v, 2)`` of a frame in the world where it is at poses ``(..., 3)``: ``(..., v, 2)``."""
    cosine, sine = np.cos(poses[..., 2, None]), np.sin(poses[..., 2, None])
    x, y = points.T
    return np.stack([poses[..., 0, None] + cosine * x - sine * y, poses[..., 1, None] + sine * x + cosine * y], -1)


def relative_pose(poses: Array, target: Array) -> Array:
    """The target pose in the frame of each pose, its heading in [-pi, pi), ``(n, 3)``."""
    offset = target[..., :2] - poses[..., :2]
    cosine, sine = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    turn = (target[..., 2] - poses[..., 2] + np.pi) % (2.0 * np.pi) - np.pi
    return np.stack(
        [cosine * offset[..., 0] + sine * offset[..., 1], cosine * offset[..., 1] - sine * offset[..., 0], turn], -1
    )
