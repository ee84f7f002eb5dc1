"""Gaps that are too narrow for a body, where they close every way from its fixed start to its fixed goal.

A disc inside a body keeps at least the body's distances. Its middle stays outside of every resting obstacle
grown by the disc's radius and the clearance. Where two grown obstacles overlap, the disc does not pass between them.
These gaps form a graph, and a cycle of it that goes around one of two places an odd number of times, and around the
other an even number of times, separates the two: no motion leads from one to the other. Since grown obstacles are
convex, all closed curves in their union are cycles of this graph up to deformation. Unbounded obstacles are joined at
infinity. Bounds of variables are not used, since they hold at the nodes only: what is refused is impossible.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, signed_distance
from pyrobocop_pyomo.geometry.polyhedra import EmptyInterior, largest_ball
from pyrobocop_pyomo.motion.rules_along_motion import is_clearance_rule
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.optional_imports import scipy

from .avoidance_record import Snapshot, fixed_times
from .rerouting import balls_of
from .scene import lower_bound_of_clearance

# Relative to the scene: how far away the middle of an unbounded part is.
FAR = 1e3


@dataclass(frozen=True, eq=False)
class ClosedGap:
    """Two resting parts between which a disc does not pass.

    Attributes
    ----------
    first, second : int
        Positions of the parts.
    width, needed : float
        Distance between the parts, and what the disc takes with its clearances.
    path : (k, 2) array
        From the middle of the first to the middle of the second, where the disc's middle cannot be; the middle of an
        unbounded part is far away.
    """

    first: int
    second: int
    width: float
    needed: float
    path: Array


def check_gaps(snapshot: Snapshot) -> None:
    """Check that no body in the plane is shut off from its goal, where poses are fixed and obstacles rest.

    Raises
    ------
    ObstacleError
        Naming the body and the widest of the gaps that shut it off, with its free width and the width needed.
    """
    record, scene = snapshot.record, snapshot.record.scene
    if record.dimension != 2 or not record.per_interval:
        return
    for name, body in scene.bodies.items():
        if name in scene.obstacles or not body.moves:
            continue
        places = sorted(fixed_times(record.poses, name))
        if len(places) < 2:
            continue
        balls = balls_of(scene, name)
        walls, grown = [], []
        for pair, wall in scene.walls_of(name):
            clearance = record.clearances[pair]
            walls.append(wall)
            least = 0.0 if is_clearance_rule(clearance) else lower_bound_of_clearance(clearance)
            grown.append(balls.inner + least)  # for the middle of the disc
        shapes = [wall.shape for wall in walls]
        gaps = closed_gaps(tuple(shapes), tuple(grown))
        unbounded = [k for k, shape in enumerate(shapes) if not shape.is_bounded]
        ends = [rotation @ balls.middle + shift for rotation, shift in (snapshot.pose(name, at) for at in places)]
        for (before, start), (after, goal) in itertools.pairwise(zip(places, ends, strict=True)):
            gap = gap_that_separates(gaps, len(walls), start, goal, unbounded)
            if gap is not None:
                first, second = walls[gap.first].name, walls[gap.second].name
                raise ObstacleError(
                    f"{snapshot.what}: '{name}' cannot get from where it is fixed at {before} to where it is fixed at "
                    f"{after}: the free width between '{first}' and '{second}' is {max(gap.width, 0.0):.6g}, needed is "
                    f"{gap.needed:.6g} (its own width {2 * balls.inner:.6g}, and the clearances), and all other ways "
                    "are closed or narrower. Move an obstacle, ask for less clearance, or move the start or the goal."
                )


@lru_cache(maxsize=8)  # walls rest, and each mesh and start of a plan asks again
def closed_gaps(shapes: tuple[Polytope, ...], widths: tuple[float, ...]) -> list[ClosedGap]:
    """Gaps between shapes in the plane that are narrower than what both are grown by together."""
    if len(shapes) < 2:
        return []
    grown = np.array(widths)
    low = np.array([shape.bounding_box[0] for shape in shapes]) - grown[:, None]
    high = np.array([shape.bounding_box[1] for shape in shapes]) + grown[:, None]
    size = float(np.ptp(np.concatenate([low, high]), axis=0).max())
    slack = NEGLIGIBLE * size  # more than rounding explains
    unbounded = [not shape.is_bounded for shape in shapes]
    low[unbounded], high[unbounded] = -np.inf, np.inf
    meet = (low[:, None] <= high[None]).all(axis=2) & (low[None] <= high[:, None]).all(axis=2)
    gaps = []
    for i, j in np.argwhere(np.triu(meet, 1)).tolist():
        first, second = shapes[i], shapes[j]
        if unbounded[i] and unbounded[j]:
            continue  # they meet at infinity
        near = signed_distance(first, second)
        room = float(grown[i] + grown[j])
        if not near.distance < room - slack:
            continue
        if near.distance > slack - room - 2.0 * (first.radius + second.radius):
            between = np.array([near.first_point, near.second_point])
        else:
            # Deep in each other: the straight line between the nearest points may leave both.
            common = _common_point(first, second)
            if common is None:
                continue
            between = common[None, :]
        far = FAR * (size + float(np.abs(between).max()))
        path = np.vstack([_middle(first, between[0], far), between, _middle(second, between[-1], far)])
        gaps.append(ClosedGap(i, j, near.distance, room, path))
    return gaps


def _middle(shape: Polytope, seen_from: Array, far: float) -> Array:
    """A point of the shape to which a straight line from a point of it stays inside; far away, if there is no end."""
    if shape.is_bounded:
        return shape.center
    return np.asarray(seen_from + far * shape.rays[0], dtype=np.float64)


def _common_point(first: Polytope, second: Polytope) -> Array | None:
    """A point inside of both shapes; None for flat ones."""
    if first.is_flat or second.is_flat:
        return None
    sides = [shape.halfspaces for shape in (first, second)]
    try:
        return largest_ball(np.vstack([side[0] for side in sides]), np.concatenate([side[1] for side in sides]))[0]
    except EmptyInterior:
        return None


def gap_that_separates(
    gaps: Sequence[ClosedGap], count: int, start: Array, goal: Array, unbounded: Sequence[int] = ()
) -> ClosedGap | None:
    """The gap that has to be widened first for a way from start to goal; None where they are not proven to be apart.

    Parameters
    ----------
    gaps : sequence of ClosedGap
    count : int
        Number of parts.
    start, goal : (2,) array
        Outside of all grown parts.
    unbounded : sequence of int
        Parts that meet at infinity.
    """
    # Of each part there are two places, by how often, modulo two, a path crosses the line from start to goal.
    places = scipy.cluster.hierarchy.DisjointSet(range(2 * count))
    for part in unbounded:
        places.merge(unbounded[0], part)
        places.merge(unbounded[0] + count, part + count)
    # From the gaps in which most is missing to the widest: the first cycle that separates is closed by its widest gap.
    for gap in sorted(gaps, key=lambda gap: gap.width - gap.needed):
        crossed = count * crosses_oddly(gap.path, start, goal)
        places.merge(gap.first, gap.second + crossed)
        places.merge(gap.first + count, gap.second + count - crossed)
        if places.connected(gap.first, gap.first + count):
            return gap
    return None


def crosses_oddly(path: Array, start: Array, goal: Array) -> bool:
    """Whether a polyline (k, 2) crosses the line segment from start to goal an odd number of times."""
    along = goal - start
    offsets = path - start
    side = along[0] * offsets[:, 1] - along[1] * offsets[:, 0]
    count = 0
    for k in np.flatnonzero((side[:-1] > 0.0) != (side[1:] > 0.0)).tolist():
        share = side[k] / (side[k] - side[k + 1])
        point = offsets[k] + share * (offsets[k + 1] - offsets[k])
        count += 0.0 < float(point @ along) < float(along @ along)
    return count % 2 == 1
