"""Where two searches meet: Reeds-Shepp paths from poses that one has reached to poses that the other has.

Each search needs half of the shunts of a path then. The cost of a search grows like a power of their number.
"""

from __future__ import annotations

import numpy as np

from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import scipy

from .best_first_search import BestFirstSearch
from .shortcuts import CHECKED_AT_ONCE

# Turning radii from one pose to the other; a turn counts as much as the way of a point one radius away.
NEAR = 0.5
NEIGHBOURS = 3
# Pairs of poses whose Reeds-Shepp paths are computed.
PAIRS = 3000


def joined_arcs(one: BestFirstSearch, other: BestFirstSearch) -> tuple[Array, Array] | None:
    """Signed lengths and curvatures of the arcs of a path from the root of one search to that of the other.

    Parameters
    ----------
    one, other : BestFirstSearch
        With the same free space; neither has found a path.
    """
    radius = one.primitives.turning_radius
    mine, others = np.array(one.poses), np.array(other.poses)
    tree = scipy.spatial.cKDTree(_as_points(others, radius))
    # A trailer needs a way to get to another angle: a turning radius ahead or back.
    leads = np.zeros(1) if one.primitives.trailer is None else np.array([-radius, radius])
    places = one.primitives.follow(mine[:, None], leads[:, None], np.zeros((len(leads), 1)))[:, :, 1]
    apart, found = tree.query(_as_points(places, radius), NEIGHBOURS, distance_upper_bound=NEAR * radius)
    chosen = np.nonzero(np.isfinite(apart))
    here, there = chosen[0], found[chosen]
    costs = np.array(one.costs)[here] + np.array(other.costs)[there]
    kept = np.argsort(costs + apart[chosen], kind="stable")[:PAIRS]
    here, there, costs = here[kept], there[kept], costs[kept]
    if not len(here):
        return None
    between, lengths, turns = one.primitives.paths_to(mine[here], others[there])
    total = between + costs
    order = np.argsort(total, axis=None, kind="stable")[:CHECKED_AT_ONCE]
    kind, pair = np.unravel_index(order[np.isfinite(total.ravel()[order])], total.shape)
    arcs, curvatures, reached = one.primitives.connecting_arcs(
        mine[here[pair]], lengths[kind, pair], turns[kind], others[there[pair]]
    )
    clear = np.flatnonzero(reached)
    clear = clear[one.are_clear(mine[here[pair[clear]]], arcs[clear], curvatures[clear])]
    if not len(clear):
        return None
    best = int(clear[0])
    there_arcs, there_bends = other.arcs_to(int(there[pair[best]]))
    one_arcs, one_bends = one.arcs_to(int(here[pair[best]]))
    moves = arcs[best] != 0.0
    # A way that is driven back needs the same steering.
    return (
        np.concatenate([one_arcs, arcs[best][moves], -there_arcs[::-1]]),
        np.concatenate([one_bends, curvatures[best][moves], there_bends[::-1]]),
    )


def _as_points(poses: Array, radius: float) -> Array:
    heading = poses[..., 2:3]
    return np.concatenate(
        [poses[..., :2], radius * np.cos(heading), radius * np.sin(heading), radius * poses[..., 3:]], axis=-1
    )
