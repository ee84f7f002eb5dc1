"""`MovingShape`: the corners of a shape at any instant, and bounds on their paths over stretches of time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.geometry import Polytope

from .bodies import Body
from .enclosures import Enclosure
from .motion import Motion
from .pose_templates import PoseTemplate, clocks_of, template_of

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_EPS = float(np.finfo(float).eps)
_SAMPLES = 17


@dataclass(frozen=True, eq=False)
class MovingShape:
    """A convex shape and the formulas of its pose.

    Attributes
    ----------
    name : str
    shape : Polytope
        In the body's frame.
    template : PoseTemplate or None
        None for a shape that rests.
    """

    name: str
    shape: Polytope
    template: PoseTemplate | None

    def corners(self, interval: Indices, fraction: Array) -> tuple[Array, Array]:
        """Corners (m, v, d) and rays (m, k, d) in the world, at local fractions of intervals."""
        count, d = len(interval), self.shape.dimension
        if self.template is None:
            vertices, rays = self.shape.vertices, self.shape.rays
            return np.broadcast_to(vertices, (count, *vertices.shape)), np.broadcast_to(rays, (count, *rays.shape))
        entries = self.template.values(interval, fraction)
        rotation, translation = entries[:, : d * d].reshape(count, d, d), entries[:, d * d :]
        turned = [np.einsum("mrc,ic->mir", rotation, each) for each in (self.shape.vertices, self.shape.rays)]
        return turned[0] + translation[:, None, :], turned[1]

    def strays(self, motion: Motion) -> Array:
        """How far the formulas misplace a corner, at most, in each interval, shape ``(intervals,)``.

        From where the nodes place it, see `PoseTemplate.strays`, and from where a rigid body has it: a quaternion that
        has length one at the nodes is a little shorter between them, and so is the body.
        """
        farthest = np.zeros(len(motion.intervals))
        if self.template is not None:
            d = self.shape.dimension
            interval, difference = self.template.strays(motion)
            turned = difference[:, : d * d].reshape(-1, d, d)
            moved = np.einsum("mrc,ic->mir", turned, self.shape.vertices) + difference[:, None, d * d :]
            # Of rays, at unit length.
            moved = np.concatenate([moved, np.einsum("mrc,ic->mir", turned, self.shape.rays)], axis=1)
            lengths = np.linalg.norm(moved, axis=2).max(axis=1)
            # Without value there is no path either, and no proof.
            np.maximum.at(farthest, interval, np.where(np.isnan(lengths), 0.0, lengths))
            farthest += self._distortion(self.template, len(farthest))
        return farthest

    def _distortion(self, template: PoseTemplate, intervals: int) -> Array:
        """How far from a rigid body's the corners are, at samples: the rotations' are polynomials of few wiggles."""
        d = self.shape.dimension
        interval = np.repeat(np.arange(intervals), _SAMPLES)
        entries = template.values(interval, np.tile(np.linspace(0.0, 1.0, _SAMPLES), intervals))
        rotation = entries[:, : d * d].reshape(-1, d, d)
        # The nearest rotation has singular values of one. Those of what is no number are left to the proof.
        finite = np.isfinite(rotation).all(axis=(1, 2))
        stretched = np.abs(np.linalg.svd(rotation[finite], compute_uv=False) - 1.0).max(axis=1, initial=0.0)
        farthest = np.zeros(intervals)
        np.maximum.at(farthest, interval[finite], stretched)
        lever = np.linalg.norm(np.concatenate([self.shape.vertices, self.shape.rays]), axis=1).max()
        return np.asarray(farthest * lever, dtype=np.float64)

    def stretches(self, interval: Indices, start: Array, end: Array) -> Stretches:
        """Bounds on the paths over stretches of intervals."""
        count, size = len(interval), self.shape.dimension * (self.shape.dimension + 1)
        if self.template is None:
            resting = np.concatenate([np.eye(self.shape.dimension).ravel(), np.zeros(self.shape.dimension)])
            value = Enclosure.of(np.tile(resting, (count, 1)))
            bend = Enclosure.of(np.zeros((count, size)))
        else:
            jets = self.template.jets(interval, start, end)
            value = _stacked([jet.value for jet in jets])
            bend = _stacked([jet.second for jet in jets])
        return Stretches(
            self.shape, start, end, self.corners(interval, start), self.corners(interval, end), value, bend
        )


@dataclass(frozen=True, eq=False)
class Stretches:
    """The paths of a shape's corners over ``m`` stretches ``[start, end]`` of local fractions.

    Attributes
    ----------
    shape : Polytope
    start, end : array, shape (m,)
    at_start, at_end : (corners (m, v, d), rays (m, k, d))
    value, bend : Enclosure, shape (m, d * d + d)
        Of the entries of the pose, and of their second derivatives.
    """

    shape: Polytope
    start: Array
    end: Array
    at_start: tuple[Array, Array]
    at_end: tuple[Array, Array]
    value: Enclosure
    bend: Enclosure

    def part(self, chosen: Any) -> Stretches:
        """Some of the stretches."""
        return Stretches(
            self.shape,
            self.start[chosen],
            self.end[chosen],
            (self.at_start[0][chosen], self.at_start[1][chosen]),
            (self.at_end[0][chosen], self.at_end[1][chosen]),
            Enclosure(self.value.low[chosen], self.value.high[chosen]),
            Enclosure(self.bend.low[chosen], self.bend.high[chosen]),
        )

    def sag_factor(self) -> Array:
        """``(end - start)^2 / 8``: a path leaves its chord by at most this times its second derivative."""
        return (self.end - self.start) ** 2 / 8.0

    def bends(self, normals: Array) -> Enclosure:
        """Second derivatives of ``n . p_i`` along given directions (m, d), shape ``(m, v)``."""
        return _along(normals, self.shape.vertices, self.bend, moves=True)

    def values(self, normals: Array) -> Enclosure:
        """``n . p_i`` along given directions (m, d), shape ``(m, v)``."""
        return _along(normals, self.shape.vertices, self.value, moves=True)

    def ray_slopes(self, normals: Array) -> Enclosure:
        """``n . ray`` along given directions (m, d), shape ``(m, k)``."""
        bend = _along(normals, self.shape.rays, self.bend, moves=False)
        ends = [np.einsum("mr,mir->mi", normals, rays) for rays in (self.at_start[1], self.at_end[1])]
        return _between(ends[0], ends[1], bend, self.sag_factor()).intersect(
            _along(normals, self.shape.rays, self.value, moves=False)
        )

    def boxes(self) -> Enclosure:
        """Boxes with sides along the axes that hold the shape during each stretch, shape ``(m, d)``."""
        low, high = [], []
        for axis in np.eye(self.shape.dimension):
            normals = np.broadcast_to(axis, (len(self.start), len(axis)))
            ends = [np.einsum("mr,mir->mi", normals, corners) for corners in (self.at_start[0], self.at_end[0])]
            path = _between(ends[0], ends[1], self.bends(normals), self.sag_factor()).intersect(self.values(normals))
            slopes = self.ray_slopes(normals)
            endless_down, endless_up = (slopes.low < 0.0).any(axis=1), (slopes.high > 0.0).any(axis=1)
            low.append(np.where(endless_down, -np.inf, path.low.min(axis=1)) - self.shape.radius)
            high.append(np.where(endless_up, np.inf, path.high.max(axis=1)) + self.shape.radius)
        return Enclosure(np.array(low).T, np.array(high).T)


def moving_shapes(motion: Motion, bodies: dict[str, Body]) -> dict[str, list[MovingShape]]:
    """The convex parts of every body with its formulas, by the name of the body.

    Raises
    ------
    ObstacleError
        Naming the body whose pose cannot be followed between the nodes.
    """
    found = {}
    clocks = clocks_of(motion)
    for name, body in bodies.items():
        template = None if body.pose is None else template_of(motion, body.pose, name, body.dimension, clocks)
        found[name] = [MovingShape(label, part, template) for label, part in body.named_parts(name)]
    return found


def _between(start: Array, end: Array, bend: Enclosure, factor: Array) -> Enclosure:
    """Values of functions with given ends and second derivatives: the chord, and the sag on either side."""
    # Where the second derivative is not positive, the graph lies on or above the chord: no sag below. NaN stays NaN.
    below = factor[:, None] * np.maximum(bend.high, 0.0)
    above = factor[:, None] * np.maximum(-bend.low, 0.0)
    slack = 8 * _EPS * (np.abs(start) + np.abs(end))
    return Enclosure(np.minimum(start, end) - below - slack, np.maximum(start, end) + above + slack)


def _stacked(entries: list[Enclosure]) -> Enclosure:
    return Enclosure(
        np.stack([each.low for each in entries], axis=1), np.stack([each.high for each in entries], axis=1)
    )


def _along(normals: Array, points: Array, entries: Enclosure, moves: bool) -> Enclosure:
    """Enclosures of ``n . (R z + t)``, or without the translation of ``n . R z``, from those of ``R`` and ``t``."""
    count, d = normals.shape
    factors = np.einsum("mr,ic->mirc", normals, points).reshape(count, len(points), d * d)
    if moves:
        shifts = np.broadcast_to(normals[:, None, :], (count, len(points), d))
        factors = np.concatenate([factors, shifts], axis=2)
    low, high = (each[:, None, : factors.shape[2]] for each in (entries.low, entries.high))
    # A factor of zero leaves an entry out, also one of which nothing is known: 0 * inf would be NaN.
    parts = [np.where(factors == 0.0, 0.0, factors * each) for each in (low, high)]
    slack = 4 * factors.shape[2] * _EPS * np.maximum(np.abs(parts[0]), np.abs(parts[1])).sum(axis=2)
    return Enclosure(
        np.minimum(parts[0], parts[1]).sum(axis=2) - slack, np.maximum(parts[0], parts[1]).sum(axis=2) + slack
    )
