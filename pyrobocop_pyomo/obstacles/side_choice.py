"""On which side to pass: normals of certificates to start from, consistent along time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import distance_of_points, separating_directions

from .formulations import PlacedSide

PREFERENCE = 1e-3  # Of a size: what a random preference for a side counts, and by how much normals are tilted.


def choose_normals(
    pieces: Sequence[tuple[PlacedSide, PlacedSide]],
    generator: np.random.Generator,
    direction: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals for the pieces of one pair, along time.

    Where the swept shapes are apart, the normal of their distance. Where they overlap, the cheapest way out may flip
    from one piece to the next; there, dynamic programming weighs how deep the overlap is along a normal against how
    much normals turn, between the normals of the pieces before and after.

    Parameters
    ----------
    pieces : sequence of (first, second)
    generator : numpy.random.Generator
        Breaks ties where both sides are equally good.
    direction : (d,), optional
        Unit vector to be used wherever shapes overlap.

    Returns
    -------
    normals : (k, d)
    gaps : (k,)
        Signed distance of the swept shapes, negative where they overlap.

    Raises
    ------
    ObstacleError
        When both are unbounded, and nothing separates them.
    """
    nearest = [distance_of_points(p.vertices, q.vertices, q_rays=q.rays, p_rays=p.rays) for p, q in pieces]
    gaps = np.array(
        [near.distance - p.shape.radius - q.shape.radius for near, (p, q) in zip(nearest, pieces, strict=True)]
    )
    normals = np.array([near.normal for near in nearest])
    if np.isneginf(gaps).any():
        names = [side.shape.name for side in pieces[int(gaps.argmin())]]
        raise ObstacleError(
            f"'{names[0]}' and '{names[1]}' overlap without end: no plane separates them anywhere. Bound one of them."
        )
    for run in _runs(gaps <= 0):
        if direction is not None:
            normals[run] = direction
            continue
        before = normals[run.start - 1] if run.start > 0 else None
        after = normals[run.stop] if run.stop < len(pieces) else None
        extra = [normal for normal in (before, after) if normal is not None]
        candidates = [_candidates(*pieces[k], [normals[k], *extra]) for k in range(run.start, run.stop)]
        preferred = np.array(generator.standard_normal(normals.shape[1]))
        preferred = preferred / np.linalg.norm(preferred)
        chosen = _cheapest_path(candidates, pieces[run], before, after, preferred)
        tilted = chosen + PREFERENCE * generator.standard_normal(chosen.shape)
        normals[run] = tilted / np.linalg.norm(tilted, axis=1, keepdims=True)
    return normals, gaps


def gap_along(normals: np.ndarray, first: PlacedSide, second: PlacedSide) -> np.ndarray:
    """Gap (k,) between two sides along each of the unit normals (k, d), radii included."""
    reach = (first.vertices @ normals.T).min(axis=0) - (second.vertices @ normals.T).max(axis=0)
    return reach - first.shape.radius - second.shape.radius


def _runs(overlapping: np.ndarray) -> list[slice]:
    """Stretches of consecutive pieces that overlap."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], overlapping.astype(int), [0]])))
    return [slice(int(start), int(stop)) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def _candidates(first: PlacedSide, second: PlacedSide, extra: list[np.ndarray]) -> np.ndarray:
    """Directions (k, d) in which to leave an overlap: facets of the Minkowski difference, and a few more.

    The axes are among them because shapes without an inside, such as points, have no facets.
    """
    dimension = first.vertices.shape[1]
    axes = np.vstack([np.eye(dimension), -np.eye(dimension)])
    facets = separating_directions(first.vertices, second.vertices, first.rays, second.rays)
    found = np.vstack([facets, axes, *extra])
    blocked = ((second.rays @ found.T) > 1e-9).any(axis=0) | ((first.rays @ found.T) < -1e-9).any(axis=0)
    return found[~blocked] if not blocked.all() else found[-1:]


def _cheapest_path(
    candidates: list[np.ndarray],
    pieces: Sequence[tuple[PlacedSide, PlacedSide]],
    before: np.ndarray | None,
    after: np.ndarray | None,
    preferred: np.ndarray,
) -> np.ndarray:
    """Normals (k, d) that cost least: mean depth over size, plus the squares of the angles that normals turn by."""
    depths = []
    for directions, (first, second) in zip(candidates, pieces, strict=True):
        depth = -gap_along(directions, first, second)
        size = max(float(np.ptp(second.vertices, axis=0).max() + np.ptp(first.vertices, axis=0).max()), 1e-12)
        depths.append((depth / size - PREFERENCE * directions @ preferred) / len(pieces))
    cost = depths[0] if before is None else depths[0] + _turning(before[None, :], candidates[0])[0]
    origins = []
    for k in range(1, len(pieces)):
        total = cost[:, None] + _turning(candidates[k - 1], candidates[k])
        origins.append(total.argmin(axis=0))
        cost = total.min(axis=0) + depths[k]
    if after is not None:
        cost = cost + _turning(candidates[-1], after[None, :])[:, 0]
    choice = [int(cost.argmin())]
    for origin in reversed(origins):
        choice.append(int(origin[choice[-1]]))
    return np.array([directions[k] for directions, k in zip(candidates, reversed(choice), strict=True)])


def _turning(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Squared angles (k, l) between unit vectors (k, d) and (l, d); squared, so that two small turns beat a flip."""
    return np.arccos(np.clip(before @ after.T, -1.0, 1.0)) ** 2
