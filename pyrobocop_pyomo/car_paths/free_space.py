"""Whether a rigid body keeps its clearance: many poses, and the motions between them, in a few array operations.

Two convex shapes in the plane are as far apart as the widest gap between them along the outward normal of a side of
either, or along the line through their nearest corners: no other direction need be tried. Between two poses of a
motion the gap along a *fixed* direction is at least the smaller one of both ends, less the deviation of the corners'
arcs from their chords. One direction that is wide enough at both ends thus proves the whole motion, and no obstacle can
be jumped over.

Gottschalk, Lin and Manocha, OBBTree: a hierarchical structure for rapid interference detection (1996), for the theorem
of the separating axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.numerics import Array, BoolArray, Indices

# An unbounded shape is cut off at this many scene sizes, for its corners only.
FAR = 1e4
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """Poses that a body may take among obstacles.

    Attributes
    ----------
    corners : (v, 2) array
        Of the body, in its own frame.
    sides, reaches : (e, 2) and (e,) arrays
        The body is ``{z : sides @ z <= reaches}``.
    normals, offsets : (f, 2) and (f,) arrays
        Sides of all obstacles, one obstacle after the other.
    first_side : (o,) int array
        Where the sides of each obstacle begin.
    points : (o, w, 2) array
        Corners of each obstacle, the last one repeated.
    needed : (o,) array
        Asked clearance and both paddings.
    """

    corners: Array
    sides: Array
    reaches: Array
    normals: Array
    offsets: Array
    first_side: Indices
    points: Array
    needed: Array

    @classmethod
    def around(cls, body: Polytope, obstacles: Sequence[Polytope], clearance: float, scene: float) -> FreeSpace:
        """Free space of a bounded body among obstacles, in a scene of a given size."""
        sides, reaches = _sides(body)
        every = [_sides(obstacle) for obstacle in obstacles]
        corners = [_corners(obstacle, scene) for obstacle in obstacles]
        most = max((len(points) for points in corners), default=0)
        padded = [np.vstack([points, np.repeat(points[-1:], most - len(points), axis=0)]) for points in corners]
        counts = [len(offsets) for _, offsets in every]
        return cls(
            corners=np.array(body.vertices),
            sides=sides,
            reaches=reaches,
            normals=np.vstack([np.zeros((0, 2)), *(normals for normals, _ in every)]),
            offsets=np.concatenate([np.zeros(0), *(offsets for _, offsets in every)]),
            first_side=np.cumsum([0, *counts[:-1]]) if counts else np.zeros(0, dtype=np.int64),
            points=np.array(padded).reshape(len(padded), most, 2),
            needed=np.array([clearance + body.radius + obstacle.radius for obstacle in obstacles]),
        )

    def distances(self, poses: Array) -> Array:
        """Exact signed distance of the padded body at each pose to each obstacle less the clearance, ``(n, o)``."""
        corners = self._placed(poses)
        if not len(self.needed):
            return np.zeros((len(poses), 0))
        widest = np.maximum.reduceat(self._from_obstacles(corners), self.first_side, axis=1)
        widest = np.maximum(widest, self._from_body(poses).max(axis=2))
        pose, obstacle = np.nonzero(widest >= -ROUNDING)  # overlapping shapes have no nearest corners
        if len(pose):
            own, other = corners[pose], self.points[obstacle]
            found = _gap_along(_between_corners(own, other), own, other)
            widest[pose, obstacle] = np.maximum(widest[pose, obstacle], found)
        return widest - self.needed

    def is_clear(self, motions: Array, curvatures: Array, spacings: Array) -> BoolArray:
        """Whether the body keeps its clearance along whole motions, also between the given poses.

        Parameters
        ----------
        motions : (m, s, 3) array
            Poses along each motion, two or more; from one to the next the body follows an arc.
        curvatures, spacings : (m,) arrays
            Largest curvature (its size) of each motion, and the longest arc from one pose to the next.
        """
        if not len(self.needed):
            return np.ones(len(motions), dtype=bool)
        # The arc of a point at distance r of the centre of the turn deviates from its chord by r (1 - cos(angle / 2)).
        # That distance is at most the distance to the body's origin plus the turning radius.
        ratio = 0.125 * (curvatures * spacings) ** 2
        of_origin = ratio / np.maximum(curvatures, 1e-12)
        deviation = (of_origin + ratio * float(np.linalg.norm(self.corners, axis=1).max()))[:, None, None]
        corners = self._placed(motions)
        sides = self._from_obstacles(corners)
        best = np.maximum.reduceat(np.minimum(sides[:, :-1], sides[:, 1:]) - deviation, self.first_side, axis=2)
        clear: BoolArray = np.asarray((best >= self.needed - ROUNDING).all(axis=(1, 2)))
        unknown = np.nonzero(~clear)[0]  # few: where obstacles are near
        if len(unknown):
            apart = np.maximum.reduceat(sides[unknown], self.first_side, axis=2)
            clear[unknown] = self._is_clear_closely(
                motions[unknown],
                corners[unknown],
                best[unknown],
                apart,
                ratio[unknown],
                of_origin[unknown],
                deviation[unknown],
            )
        return clear

    def _is_clear_closely(
        self,
        motions: Array,
        corners: Array,
        best: Array,
        apart: Array,
        ratio: Array,
        of_origin: Array,
        deviation: Array,
    ) -> BoolArray:
        """The same, also along the normals of the body's sides and between nearest corners."""
        gaps = self._from_body(motions, ratio)
        along_motion = np.minimum(gaps[:, :-1], gaps[:, 1:]).max(axis=3) - of_origin[:, None, None]
        best, apart = np.maximum(best, along_motion), np.maximum(apart, gaps.max(axis=3))
        needed = self.needed - ROUNDING
        # Where no side gives a wide enough gap, the nearest corners may, unless the shapes overlap.
        motion, step, obstacle = np.nonzero((best < needed) & (np.minimum(apart[:, :-1], apart[:, 1:]) > -ROUNDING))
        if len(motion):
            start, end, other = corners[motion, step], corners[motion, step + 1], self.points[obstacle]
            for own in (start, end):
                along = _between_corners(own, other)
                gap = np.minimum(_gap_along(along, start, other), _gap_along(along, end, other))
                found = gap - deviation[motion, 0, 0]
                best[motion, step, obstacle] = np.maximum(best[motion, step, obstacle], found)
        return np.asarray((best >= needed).all(axis=(1, 2)))

    def _placed(self, poses: Array) -> Array:
        """Corners of the body in the world, ``(..., v, 2)``."""
        cosine, sine = np.cos(poses[..., 2, None]), np.sin(poses[..., 2, None])
        x, y = self.corners.T
        return np.stack([poses[..., 0, None] + cosine * x - sine * y, poses[..., 1, None] + sine * x + cosine * y], -1)

    def _from_obstacles(self, corners: Array) -> Array:
        """Gap along the normal of each side of each obstacle, ``(..., f)``."""
        # Not a matrix product: that would be one call of BLAS per pose.
        along = corners[..., :1] * self.normals[:, 0] + corners[..., 1:] * self.normals[:, 1]
        return np.asarray(along.min(axis=-2) - self.offsets)

    def _from_body(self, poses: Array, ratio: Array | float = 0.0) -> Array:
        """Gap along the normal of each side of the body, ``(..., o, e)``, less ``ratio`` times distances of points."""
        away = self.points - poses[..., None, None, :2]
        cosine, sine = np.cos(poses[..., 2])[..., None, None], np.sin(poses[..., 2])[..., None, None]
        own_x = cosine * away[..., 0] + sine * away[..., 1]
        own_y = cosine * away[..., 1] - sine * away[..., 0]
        lift = np.reshape(ratio, np.shape(ratio) + (1,) * (own_x.ndim - np.ndim(ratio))) * np.hypot(own_x, own_y)
        along = own_x[..., None] * self.sides[:, 0] + own_y[..., None] * self.sides[:, 1] - lift[..., None]
        return np.asarray(along.min(axis=-2) - self.reaches)


def _sides(shape: Polytope) -> tuple[Array, Array]:
    """Outward unit normals and offsets; of a segment its two sides and ends, of a point any four."""
    if not shape.is_flat:
        return shape.halfspaces
    along = shape.vertices[-1] - shape.vertices[0] if shape.is_bounded else shape.rays[0]
    length = float(np.linalg.norm(along))
    along = along / length if length > 0.0 else np.array([1.0, 0.0])
    across = np.array([-along[1], along[0]])
    normals = np.array([across, -across] if not shape.is_bounded else [across, -across, along, -along])
    return normals, (normals @ shape.vertices.T).max(axis=1)


def _corners(shape: Polytope, scene: float) -> Array:
    """Corners, and in place of rays corners far away."""
    if shape.is_bounded:
        return np.array(shape.vertices)
    # The middle of two rays as well: without it the cut would pass close by a wedge that is nearly a half-plane.
    rays = [*shape.rays, *(a + b for i, a in enumerate(shape.rays) for b in shape.rays[:i])]
    directions = [ray / np.linalg.norm(ray) for ray in rays if np.linalg.norm(ray) > 1e-6]
    return np.vstack([shape.vertices, *(shape.vertices + FAR * scene * ray for ray in directions)])


def _between_corners(own: Array, other: Array) -> Array:
    """Unit vectors to the nearest corner of one from that of the other, ``(k, 2)``; zero where they touch."""
    apart = own[:, :, None, :] - other[:, None, :, :]
    lengths = np.hypot(apart[..., 0], apart[..., 1]).reshape(len(own), -1)
    nearest = lengths.argmin(axis=1)
    rows = np.arange(len(own))
    return np.asarray(
        apart.reshape(len(own), -1, 2)[rows, nearest] / np.maximum(lengths[rows, nearest], 1e-300)[:, None]
    )


def _gap_along(along: Array, own: Array, other: Array) -> Array:
    least = np.einsum("kvd,kd->kv", own, along).min(axis=1)
    return np.asarray(least - np.einsum("kwd,kd->kw", other, along).max(axis=1))
