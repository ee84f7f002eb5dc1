"""Whether a rigid body keeps its clearance: many poses, and the motions between them, in a few array operations.

Two convex shapes in the plane are as far apart as the widest gap between them along the outward normal of a side of
either, or along the line through their nearest corners: no other direction need be tried. Between two poses of a
motion the gap along a *fixed* direction is at least the smaller one of both ends, less the deviation of the corners'
arcs from their chords. One direction that is wide enough at both ends thus proves the whole motion, and no obstacle can
be jumped over.

Most steps are far from everything. Discs that cover the body and a grid of distances decide these, circles around
body and obstacles most of the others.

Gottschalk, Lin and Manocha, OBBTree: a hierarchical structure for rapid interference detection (1996), for the theorem
of the separating axis.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.numerics import Array, BoolArray, Indices
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE

from .car_kinematics import Trailer, placed

# An unbounded shape is cut off at this many scene sizes, for its corners only.
FAR = 1e4
MOST_DISCS = 5


@dataclass(frozen=True, eq=False)
class _Grid:
    """Lower bounds of what points have left of their distance to the nearest obstacle after the clearance.

    Attributes
    ----------
    origin : (2,) array
    cell : float
    bounds : (nx, ny) array
        For all points of each square cell; beyond the grid nothing is known.
    """

    origin: Array
    cell: float
    bounds: Array

    def at(self, points: Array) -> Array:
        """Bounds ``(...)`` of points ``(..., 2)``."""
        place = np.floor((points - self.origin) / self.cell)
        counts = np.array(self.bounds.shape)
        known = np.asarray(((place >= 0) & (place < counts)).all(axis=-1))
        inside = np.where(known[..., None], place, 0).astype(np.int64)
        return np.where(known, self.bounds[inside[..., 0], inside[..., 1]], -np.inf)


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """Poses that a body may take among obstacles.

    Attributes
    ----------
    corners : (v, 2) array
        Of the body, in its own frame.
    sides, reaches : (e, 2) and (e,) arrays
        The body is ``{z : sides @ z <= reaches}``.
    discs : (k, 2) array
        Middles of discs that cover the body.
    disc_radius : float
    normals, offsets : (o, f, 2) and (o, f) arrays
        Sides of each obstacle, the last one repeated.
    points : (o, w, 2) array
        Corners of each obstacle, the last one repeated.
    needed : (o,) array
        Asked clearance and both paddings.
    grid : _Grid or None
    """

    corners: Array
    sides: Array
    reaches: Array
    discs: Array
    disc_radius: float
    normals: Array
    offsets: Array
    points: Array
    needed: Array
    grid: _Grid | None = None

    @classmethod
    def around(cls, body: Polytope, obstacles: Sequence[Polytope], clearance: float, scene: float) -> FreeSpace:
        """Free space of a bounded body among obstacles, in a scene of a given size."""
        body, obstacles = body.covered, [obstacle.covered for obstacle in obstacles]
        sides, reaches = _sides(body)
        every = [_sides(obstacle) for obstacle in obstacles]
        corners = [_corners(obstacle, scene) for obstacle in obstacles]
        discs, disc_radius = _covering_discs(np.array(body.covering))
        return cls(
            corners=np.array(body.covering),
            sides=sides,
            reaches=reaches,
            discs=discs,
            disc_radius=disc_radius,
            normals=_padded([normals for normals, _ in every], (2,)),
            offsets=_padded([offsets for _, offsets in every], ()),
            points=_padded(corners, (2,)),
            needed=np.array([clearance + body.radius + obstacle.radius for obstacle in obstacles]),
        )

    def with_grid(self, low: Array, high: Array, cell: float, enough: float) -> FreeSpace:
        """The same with a grid of distances over a region, which need not be known beyond what is enough."""
        counts = np.maximum(np.ceil((high - low) / cell).astype(int), 1)
        bounds = self._room(low, cell, counts, enough) - math.sqrt(0.5) * cell
        return replace(self, grid=_Grid(np.array(low, dtype=float), cell, bounds))

    def cells_free_of_point(self, low: Array, cell: float, counts: Array) -> BoolArray:
        """Which cells of a grid hold a place that is no nearer to any obstacle than the clearance; for points.

        The body counts as a point with the radius that `needed` has.
        """
        return np.asarray(self._room(low, cell, counts, 0.0) >= -math.sqrt(0.5) * cell)

    def _room(self, low: Array, cell: float, counts: Array, most: float) -> Array:
        """What the middles of cells have left of their distance to the nearest obstacle, up to `most`."""
        room = np.full(counts.tolist(), most)
        for points, normals, offsets, needed in zip(self.points, self.normals, self.offsets, self.needed, strict=True):
            first = np.clip(np.floor((points.min(axis=0) - needed - most - low) / cell), 0, counts).astype(int)
            last = np.clip(np.ceil((points.max(axis=0) + needed + most - low) / cell), 0, counts).astype(int)
            axes = [low[i] + (np.arange(first[i], last[i]) + 0.5) * cell for i in range(2)]
            places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
            gaps = (places @ normals.T - offsets).max(axis=-1)
            # Beside a corner the distance is that to the corner, and more than any gap.
            outside = (gaps > 0.0) & (gaps < needed + most)
            gaps[outside] = _distances_to_ring(places[outside], points)
            window = room[first[0] : last[0], first[1] : last[1]]
            np.minimum(window, gaps - needed, out=window)
        return room

    def is_clear(self, motions: Array, curvatures: Array, spacings: Array) -> BoolArray:
        """Whether the body keeps its clearance along whole motions, also between the given poses.

        Parameters
        ----------
        motions : (m, s, 3) array
            Poses along each motion, two or more; from one to the next the body follows an arc.
        curvatures, spacings : (m,) arrays
            Largest curvature (its size) of each motion, and the longest arc from one pose to the next.
        """
        clear = np.ones(len(motions), dtype=bool)
        if not len(self.needed) or not len(motions):
            return clear
        # No point of the body is farther from where it is at one of the two poses.
        moved = 0.5 * spacings * (1.0 + curvatures * self.corner_radius)
        reach = np.repeat(moved, motions.shape[1])
        away = self._keeps_away(motions.reshape(-1, 3), reach).reshape(motions.shape[:2])
        motion, step = np.nonzero(~(away[:, :-1] & away[:, 1:]))
        found, obstacle = self._near(motions[motion, step], 2.0 * moved[motion])
        motion, step = motion[found], step[found]
        if len(motion):
            proven = self._are_clear(
                motions[motion, step], motions[motion, step + 1], obstacle, curvatures[motion], spacings[motion]
            )
            clear[motion[~proven]] = False
        return clear

    def _keeps_away(self, poses: Array, moved: Array) -> BoolArray:
        """Whether the grid proves that bodies keep their clearances when all points move by so much, ``(n,)``."""
        if self.grid is None:
            return np.zeros(len(poses), dtype=bool)
        places = placed(poses, self.discs)
        return np.asarray((self.grid.at(places) >= (self.disc_radius + moved + NEGLIGIBLE)[:, None]).all(axis=1))

    def _near(self, poses: Array, moved: Array) -> tuple[Indices, Indices]:
        """Pairs of a pose and an obstacle that the discs around the body do not keep apart."""
        places = placed(poses, self.discs).reshape(-1, 2).T
        pose, obstacle = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
        for k, needed in enumerate(self.needed.tolist()):
            gaps = (self.normals[k] @ places - self.offsets[k][:, None]).max(axis=0).reshape(-1, len(self.discs))
            pose.append(np.flatnonzero(gaps.min(axis=1) <= needed + self.disc_radius + moved + NEGLIGIBLE))
            obstacle.append(np.full(len(pose[-1]), k))
        return np.concatenate(pose), np.concatenate(obstacle)

    def _are_clear(
        self, before: Array, after: Array, obstacle: Indices, curvatures: Array, spacings: Array
    ) -> BoolArray:
        """Whether one direction is wide enough at both poses of a step, ``(p,)``."""
        # The arc of a point at distance r of the centre of the turn deviates from its chord by r (1 - cos(angle / 2)).
        # That distance is at most the distance to the body's origin plus the turning radius.
        ratio = 0.125 * (curvatures * spacings) ** 2
        of_origin = ratio / np.maximum(curvatures, 1e-12)
        deviation = of_origin + ratio * self.corner_radius
        needed, other = self.needed[obstacle] - NEGLIGIBLE, self.points[obstacle]
        start, end = placed(before, self.corners), placed(after, self.corners)
        gaps = np.minimum(self._from_obstacles(start, obstacle), self._from_obstacles(end, obstacle)).max(axis=1)
        clear = np.asarray(gaps - deviation >= needed)
        gaps = np.minimum(*(self._from_body(poses, other, ratio) for poses in (before, after))).max(axis=1)
        clear |= gaps - of_origin >= needed
        left = np.flatnonzero(~clear)
        start, end, other = start[left], end[left], other[left]
        for own in (start, end) if len(left) else ():
            along = _between_corners(own, other)
            gaps = np.minimum(_gap_along(along, start, other), _gap_along(along, end, other))
            clear[left] |= gaps - deviation[left] >= needed[left]
        return clear

    @property
    def corner_radius(self) -> float:
        """Distance of the farthest corner of the body from its origin."""
        return float(np.linalg.norm(self.corners, axis=1).max())

    def gaps_between_vehicles(self, first: Array, second: Array) -> Array:
        """Widest gap, ``(p,)``, along normals of two such bodies at poses ``(p, 3)``: at most their distance."""
        ones, others = placed(first, self.corners), placed(second, self.corners)
        gaps = [self._from_body(first, others).max(axis=1), self._from_body(second, ones).max(axis=1)]
        return np.asarray(np.maximum(*gaps))

    def _from_obstacles(self, corners: Array, obstacle: Indices) -> Array:
        """Gap along the normal of each side of an obstacle, ``(p, f)``."""
        normals = self.normals[obstacle]
        least = np.full(normals.shape[:2], np.inf)
        for k in range(corners.shape[1]):
            least = np.minimum(least, corners[:, k, :1] * normals[..., 0] + corners[:, k, 1:] * normals[..., 1])
        return np.asarray(least - self.offsets[obstacle])

    def _from_body(self, poses: Array, points: Array, ratio: Array | float = 0.0) -> Array:
        """Gap along the normal of each side of the body, ``(p, e)``, less ``ratio`` times distances of points.

        Parameters
        ----------
        poses : (p, 3) array
        points : (p, w, 2) array
            Corners of an obstacle for each pose.
        ratio : (p,) array or float
        """
        away = points - poses[:, None, :2]
        cosine, sine = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
        own_x = cosine * away[..., 0] + sine * away[..., 1]
        own_y = cosine * away[..., 1] - sine * away[..., 0]
        lift = np.reshape(ratio, (-1, 1)) * np.hypot(own_x, own_y)
        gaps = [(own_x * a + own_y * b - lift).min(axis=1) - reach
                for (a, b), reach in zip(self.sides.tolist(), self.reaches.tolist(), strict=True)]  # fmt: skip
        return np.stack(gaps, axis=-1)


@dataclass(frozen=True, eq=False)
class FreeSpaceWithTrailer:
    """Poses, with the angle of the trailer as a fourth number, that a car and its trailer may take among obstacles.

    Attributes
    ----------
    of_car, of_trailer : FreeSpace
    trailer : Trailer
    """

    of_car: FreeSpace
    of_trailer: FreeSpace
    trailer: Trailer

    def is_clear(self, motions: Array, curvatures: Array, spacings: Array) -> BoolArray:
        """As for `FreeSpace`, from motions ``(m, s, 4)``; the angle is within its limit as well."""
        clear: BoolArray = np.asarray(self.trailer.are_within(motions).all(axis=1))
        clear[clear] = self.of_car.is_clear(motions[clear, :, :3], curvatures[clear], spacings[clear])
        arcs = self.trailer.as_arcs(curvatures[clear], spacings[clear])
        clear[clear] = self.of_trailer.is_clear(self.trailer.poses(motions[clear]), *arcs)
        return clear


def are_free(space: FreeSpace | FreeSpaceWithTrailer, poses: Array) -> BoolArray:
    """Whether everything keeps its clearance at each of the poses ``(n, 3)``, or ``(n, 4)``."""
    nothing = np.zeros(len(poses))
    return space.is_clear(np.stack([poses, poses], axis=1), nothing, nothing)


def _padded(rows: Sequence[Any], shape: tuple[int, ...]) -> Array:
    """Arrays of different lengths as one, each with its last entry repeated."""
    most = max((len(row) for row in rows), default=0)
    padded = [np.concatenate([row, np.repeat(row[-1:], most - len(row), axis=0)]) for row in rows]
    return np.array(padded, dtype=float).reshape(len(padded), most, *shape)


def _covering_discs(corners: Array) -> tuple[Array, float]:
    """Middles ``(k, 2)`` and the radius of discs that cover the box around some corners."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    size = high - low
    axis = int(size.argmax())
    count = int(np.clip(math.ceil(size[axis] / max(size[1 - axis], 1e-9 * size[axis], 1e-300)), 1, MOST_DISCS))
    middles = np.tile(0.5 * (low + high), (count, 1))
    middles[:, axis] = low[axis] + (np.arange(count) + 0.5) * size[axis] / count
    return middles, 0.5 * math.hypot(size[axis] / count, size[1 - axis])


def _sides(shape: Polytope) -> tuple[Array, Array]:
    """Outward unit normals and offsets; of a segment its two sides and ends, of a point any four."""
    if not shape.is_flat:
        return shape.halfspaces
    along = shape.covering[-1] - shape.covering[0] if shape.is_bounded else shape.rays[0]
    length = float(np.linalg.norm(along))
    along = along / length if length > 0.0 else np.array([1.0, 0.0])
    across = np.array([-along[1], along[0]])
    normals = np.array([across, -across] if not shape.is_bounded else [across, -across, along, -along])
    return normals, (normals @ shape.covering.T).max(axis=1)


def _corners(shape: Polytope, scene: float) -> Array:
    """Corners, and in place of rays corners far away."""
    if shape.is_bounded:
        return np.array(shape.covering)
    # The middle of two rays as well: without it the cut would pass close by a wedge that is nearly a half-plane.
    rays = [*shape.rays, *(a + b for i, a in enumerate(shape.rays) for b in shape.rays[:i])]
    directions = [ray / np.linalg.norm(ray) for ray in rays if np.linalg.norm(ray) > 1e-6]
    return np.vstack([shape.covering, *(shape.covering + FAR * scene * ray for ray in directions)])


def _between_corners(own: Array, other: Array) -> Array:
    """Unit vectors between the nearest corners, towards the first, ``(k, 2)``; zero where they touch."""
    apart = own[:, :, None, :] - other[:, None, :, :]
    lengths = np.hypot(apart[..., 0], apart[..., 1]).reshape(len(own), -1)
    nearest = lengths.argmin(axis=1)
    rows = np.arange(len(own))
    return np.asarray(
        apart.reshape(len(own), -1, 2)[rows, nearest] / np.maximum(lengths[rows, nearest], 1e-300)[:, None]
    )


def _distances_to_ring(places: Array, ring: Array) -> Array:
    """Distances ``(n,)`` of places outside of a convex shape to its nearest side, from its corners in any order."""
    about = ring - ring.mean(axis=0)
    ring = ring[np.argsort(np.arctan2(about[:, 1], about[:, 0]), kind="stable")]
    hull = np.concatenate([ring, ring[:1]])
    sides = hull[1:] - hull[:-1]
    squares = np.maximum((sides**2).sum(axis=1), 1e-300)
    distances = np.full(len(places), np.inf)
    for corner, side, square in zip(hull[:-1], sides, squares, strict=True):
        away = places - corner
        share = np.clip(away @ side / square, 0.0, 1.0)
        distances = np.minimum(distances, np.hypot(*(away - share[:, None] * side).T))
    return distances


def _gap_along(along: Array, own: Array, other: Array) -> Array:
    least = np.einsum("kvd,kd->kv", own, along).min(axis=1)
    return np.asarray(least - np.einsum("kwd,kd->kw", other, along).max(axis=1))
