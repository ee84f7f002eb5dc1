"""Start values of separations from exact distances at the current poses.

Where shapes overlap, a normal of the deepest overlap may flip from one segment to the next. There, dynamic programming
chooses normals that are cheap and consistent along time.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, separating_directions
from pyrobocop_pyomo.numerics import Array, BoolArray

from .avoidance_record import MotionSegment, Snapshot, gap_along
from .broad_phase import swept_distances
from .scene import BodyPair
from .separation_rows import start_plane, unit_normal_of

LOGGER = logging.getLogger(__name__)

# Relative to the size of the shapes: weight of a random preference for a direction, and tilt of the normals.
PREFERENCE = 1e-3


def set_start_values(
    block: Any,
    snapshot: Snapshot,
    segments: Sequence[MotionSegment],
    directions: Mapping[BodyPair, Array],
) -> dict[BodyPair, int]:
    """Set start values of separations; others beside them in time have some, and are left alone.

    Parameters
    ----------
    block : ObstacleAvoidanceBlockData
    snapshot : Snapshot
    segments : sequence of MotionSegment
        Of the separations.
    directions : mapping of body pair to unit vector (d,)
        Used wherever shapes overlap.

    Returns
    -------
    dict of pair of parts to int
        Number of segments on which they overlap at the initial guess; pairs without overlap are left out.
    """
    record, generator = snapshot.record, np.random.default_rng(0)
    gaps, nearest = swept_distances(snapshot, segments)
    known = {segment.index: k for k, segment in enumerate(segments)}
    by_pair = record.by_part_pair()
    overlapping: dict[BodyPair, int] = {}
    for pair in dict.fromkeys((segment.first, segment.second) for segment in segments):
        along = by_pair[pair]
        bodies = record.body_pair(along[0])
        for run in _runs(np.array([segment.index in known for segment in along])):
            beside = [along[k : k + 1] if k >= 0 else [] for k in (run.start - 1, run.stop)]
            ends = [unit_normal_of(block, of[0].index) if of else None for of in beside]
            rows = [known[segment.index] for segment in along[run]]
            normals = choose_normals(
                snapshot, along[run], gaps[rows], nearest[rows], generator, directions.get(bodies), (ends[0], ends[1])
            )
            for segment, normal in zip(along[run], normals, strict=True):
                start_plane(block, segment.index, *snapshot.placed_pair(segment), normal)
            count = int((gaps[rows] <= 0).sum())
            if count:
                overlapping[pair] = overlapping.get(pair, 0) + count
    if overlapping:
        LOGGER.info(
            "%s: the initial guess overlaps for %s; normals are chosen along time.",
            snapshot.what,
            ", ".join(f"'{a}' and '{b}' ({count} separations)" for (a, b), count in overlapping.items()),
        )
    return overlapping


# --------------------------------------------------------------------------------------------------- choice of normals


def choose_normals(
    snapshot: Snapshot,
    segments: Sequence[MotionSegment],
    gaps: Array,
    nearest: Array,
    generator: np.random.Generator,
    direction: Array | None = None,
    beside: tuple[Array | None, Array | None] = (None, None),
) -> Array:
    """Unit normals for the segments of one pair of parts, along time, shape ``(k, d)``.

    Where the swept shapes are apart, the normal of their distance. Where they overlap, normals with the least sum of
    overlap depths and turns, between the normals of the segments before and after.

    Parameters
    ----------
    snapshot : Snapshot
    segments : sequence of MotionSegment
    gaps : (k,)
        Signed distances of the swept shapes, negative where they overlap.
    nearest : (k, d)
        Their normals.
    generator : numpy.random.Generator
        Breaks ties where opposite directions are equally good.
    direction : (d,), optional
        Unit vector to be used wherever shapes overlap.
    beside : pair of (d,) or None
        Normals of the segments before and after all of these.

    Raises
    ------
    ObstacleError
        When both are unbounded, and no direction separates them.
    """
    if np.isneginf(gaps).any():
        segment = segments[int(gaps.argmin())]
        raise ObstacleError(
            f"'{segment.first}' and '{segment.second}' overlap without end: no plane separates them anywhere. Bound "
            "one of them."
        )
    normals = nearest.copy()
    for run in _runs(gaps <= 0):
        if direction is not None:
            normals[run] = direction
            continue
        before = normals[run.start - 1] if run.start > 0 else beside[0]
        after = normals[run.stop] if run.stop < len(segments) else beside[1]
        extra = [normal for normal in (before, after) if normal is not None]
        pairs = [snapshot.placed_pair(segment) for segment in segments[run]]
        candidates = [_candidates(*pair, [normal, *extra]) for pair, normal in zip(pairs, normals[run], strict=True)]
        preferred = np.array(generator.standard_normal(normals.shape[1]))
        preferred = preferred / np.linalg.norm(preferred)
        chosen = _cheapest_path(candidates, pairs, before, after, preferred)
        tilted = chosen + PREFERENCE * generator.standard_normal(chosen.shape)
        normals[run] = tilted / np.linalg.norm(tilted, axis=1, keepdims=True)
    return normals


def _runs(overlapping: BoolArray) -> list[slice]:
    """Runs of consecutive segments that overlap."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], overlapping.astype(int), [0]])))
    return [slice(int(start), int(stop)) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def _candidates(first: Polytope, second: Polytope, extra: list[Array]) -> Array:
    """Directions (k, d) in which to leave an overlap: facets of the Minkowski difference, axes, and given ones.

    The axes are included because shapes without an interior, such as points, have no facets.
    """
    axes = np.vstack([np.eye(first.dimension), -np.eye(first.dimension)])
    facets = separating_directions(first.covering, second.covering, first.rays, second.rays)
    directions = np.vstack([facets, axes, *extra])
    blocked = ((second.rays @ directions.T) > 1e-9).any(axis=0) | ((first.rays @ directions.T) < -1e-9).any(axis=0)
    return directions[~blocked] if not blocked.all() else directions[-1:]


def _cheapest_path(
    candidates: list[Array],
    pairs: Sequence[tuple[Polytope, Polytope]],
    before: Array | None,
    after: Array | None,
    preferred: Array,
) -> Array:
    """Normals (k, d) of least cost: mean depth over size, plus the squared angles between consecutive normals."""
    depths = []
    for directions, (first, second) in zip(candidates, pairs, strict=True):
        depth = -gap_along(directions, first, second)
        size = max(sum(float(np.ptp(shape.bounding_box, axis=0).max()) for shape in (first, second)), 1e-12)
        depths.append((depth / size - PREFERENCE * directions @ preferred) / len(pairs))
    cost = depths[0] if before is None else depths[0] + _turning(before[None, :], candidates[0])[0]
    origins = []
    for k in range(1, len(pairs)):
        total = cost[:, None] + _turning(candidates[k - 1], candidates[k])
        origins.append(total.argmin(axis=0))
        cost = total.min(axis=0) + depths[k]
    if after is not None:
        cost = cost + _turning(candidates[-1], after[None, :])[:, 0]
    choice = [int(cost.argmin())]
    for origin in reversed(origins):
        choice.append(int(origin[choice[-1]]))
    return np.array([directions[k] for directions, k in zip(candidates, reversed(choice), strict=True)])


def _turning(before: Array, after: Array) -> Array:
    """Squared angles (k, l) between unit vectors (k, d) and (l, d); squares favour two small turns over a flip."""
    return np.arccos(np.clip(before @ after.T, -1.0, 1.0)) ** 2
