"""Shortcuts: a path with fewer cusps and less length, from pieces of a path that was found and Reeds-Shepp paths.

A search in cells of poses leaves cusps behind that nothing asks for. Poses along its path, and some beyond its cusps
where the car goes on a little, are taken as the nodes of a graph without cycles; its edges are Reeds-Shepp paths
from earlier to later nodes. Edges that might be part of a cheaper way are checked for collisions, the most promising
first, until none is left or the budget is spent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.numerics import Array, BoolArray, Indices
from pyrobocop_pyomo.optional_imports import scipy

from .best_first_search import BestFirstSearch, first_nonzero
from .free_space import are_free
from .motion_primitives import count_cusps

NODES = 36
# Turning radii by which a car goes on beyond a cusp at most, in three steps.
BEYOND = 0.6
# A cusp that the search accepted is worth this many of its costs here: it would need a stop.
CUSP_FACTOR = 2.0
# Reeds-Shepp paths per pair of nodes.
KEPT_PER_PAIR = 2
CHECKED_AT_ONCE = 200
# Of shortcuts, and of checks in each of them, at most.
ROUNDS = 6
# Turning radii that a round saves at least: a solver takes off the rest, and shorter ways only cost time.
LEAST_SAVING = 0.05


@dataclass(frozen=True, eq=False)
class _Edges:
    """Ways from node to node.

    Attributes
    ----------
    start, end : (e,) int arrays
    cost : (e,) array
        Length and cusps within.
    first, last : (e,) arrays
        Directions in which an edge begins and ends.
    lengths, turns : (e, 5) arrays
        Of the segments of a Reeds-Shepp path.
    own : (e,) array
        Whether an edge is a piece of the path itself.
    """

    start: Indices
    end: Indices
    cost: Array
    first: Array
    last: Array
    lengths: Array
    turns: Array
    own: BoolArray


def with_shortcuts(search: BestFirstSearch, lengths: Array, curvatures: Array) -> tuple[Array, Array]:
    """Signed lengths and curvatures of arcs of a path that is no worse than the one given, from the root of a search.

    Ways that save less than a twentieth of a turning radius are not looked for.

    Parameters
    ----------
    search : BestFirstSearch
        With the free space, the limits and the costs.
    lengths, curvatures : (s,) arrays
        Of the arcs of the path.
    """
    for _ in range(ROUNDS):
        better = _shortened(search, lengths, curvatures)
        if better is None:
            break
        lengths, curvatures = better
    return lengths, curvatures


def _shortened(search: BestFirstSearch, lengths: Array, curvatures: Array) -> tuple[Array, Array] | None:
    moves = np.abs(lengths) > 0.0
    lengths, curvatures = lengths[moves], curvatures[moves]
    poses = search.primitives.follow(search.root, lengths, curvatures)
    places, number, on_path = _nodes(search, poses, lengths, curvatures)
    edges = _edges(search, places, number, on_path, lengths)
    cusp = CUSP_FACTOR * search.primitives.cusp_cost
    clear = edges.own.copy()
    banned = np.zeros(len(clear), dtype=bool)
    least = LEAST_SAVING * search.primitives.turning_radius
    best, way, _ = _cheapest_way(edges, clear, len(places), cusp)
    before = best
    for _ in range(ROUNDS):
        _, _, bound = _cheapest_way(edges, ~banned, len(places), cusp)
        unknown = np.flatnonzero(~clear & ~banned & (bound < best - least))
        if not len(unknown):
            break
        chosen = unknown[np.argsort(bound[unknown], kind="stable")[:CHECKED_AT_ONCE]]
        good = _are_clear(search, places, edges, chosen)
        clear[chosen[good]], banned[chosen[~good]] = True, True
        if good.any():
            best, way, _ = _cheapest_way(edges, clear, len(places), cusp)
    return _arcs_of(search, places, edges, way, number, lengths, curvatures) if best < before - least else None


def _nodes(
    search: BestFirstSearch, poses: Array, lengths: Array, curvatures: Array
) -> tuple[Array, Indices, BoolArray]:
    """Poses in the order of the path, ``(n, 3)``; of each its number on the path or its cusp's, and which of both."""
    driven = np.concatenate([[0.0], np.cumsum(np.abs(lengths))])
    even = np.searchsorted(driven, np.linspace(0.0, driven[-1], NODES))
    cusps = np.flatnonzero(np.diff(np.sign(lengths))) + 1
    chosen = np.unique(np.clip([*even, *cusps, 0, len(lengths)], 0, len(lengths)))
    places, number, on_path = [], [], []
    radius = search.primitives.turning_radius
    for k in chosen.tolist():
        places.append(poses[k])
        number.append(k)
        on_path.append(True)
        if k in cusps:
            sign = np.sign(lengths[k - 1])
            for bend in dict.fromkeys((float(curvatures[k - 1]), 0.0, 1.0 / radius, -1.0 / radius)):
                arcs = np.full(3, sign * radius * BEYOND / 3)
                beyond = search.primitives.follow(poses[k], arcs, np.full(len(arcs), bend))[1:]
                free = are_free(search.space, beyond) & search.within(beyond[None])
                clear = beyond[np.logical_and.accumulate(free)]
                places += list(clear)
                number += [k] * len(clear)
                on_path += [False] * len(clear)
    return np.array(places), np.array(number), np.array(on_path)


def _edges(search: BestFirstSearch, places: Array, number: Indices, on_path: BoolArray, lengths: Array) -> _Edges:
    """All pieces of the path from node to node, and the cheapest Reeds-Shepp paths that are cheaper than these."""
    primitives, cusp = search.primitives, CUSP_FACTOR * search.primitives.cusp_cost
    count = len(places)
    driven = np.concatenate([[0.0], np.cumsum(np.abs(lengths))])
    turned = np.concatenate([[0.0, 0.0], np.cumsum(np.diff(np.sign(lengths)) != 0.0)])
    start, end = np.triu_indices(count, 1)
    found, words, turns = primitives.paths_to(places[start], places[end])
    costs = np.abs(words).sum(axis=2) + cusp * count_cusps(words)
    costs[~np.isfinite(found) | (np.abs(words).sum(axis=2) <= 0.0)] = np.inf
    best = np.argsort(costs, axis=0, kind="stable")[:KEPT_PER_PAIR]
    pair = np.broadcast_to(np.arange(len(start)), best.shape)
    here = driven[number[end]] - driven[number[start]] + cusp * (turned[number[end]] - turned[number[start]])
    useful = costs[best, pair] < here[pair] + 2.0 * cusp + primitives.turning_radius
    word, pair = best[useful], pair[useful]
    segments = words[word, pair]
    nodes = np.flatnonzero(on_path)
    signs, spans = np.sign(lengths[number[nodes[:-1]]]), np.diff(driven[number[nodes]])
    return _Edges(
        np.concatenate([nodes[:-1], start[pair]]),
        np.concatenate([nodes[1:], end[pair]]),
        np.concatenate([spans, costs[word, pair]]),
        np.concatenate([signs, np.sign(first_nonzero(segments))]),
        np.concatenate([signs, np.sign(first_nonzero(segments[:, ::-1]))]),
        np.concatenate([np.zeros((len(signs), segments.shape[1])), segments]),
        np.concatenate([np.zeros((len(signs), segments.shape[1])), turns[word]]),
        np.arange(len(signs) + len(word)) < len(signs),
    )


def _cheapest_way(edges: _Edges, allowed: BoolArray, count: int, cusp: float) -> tuple[float, list[int], Array]:
    """Cost and edges from the first node to the last, and for each edge a bound of what such a way along it costs.

    The graph has two vertices for each node, one for each direction in which the car gets there, and one for each edge.
    """
    used = np.flatnonzero(allowed).astype(np.int32)
    start, forwards, half = 2 * edges.start[used], edges.first[used] > 0, 0.5 * edges.cost[used]
    origins = np.concatenate([start + forwards, start + ~forwards, 2 * count + used]).astype(np.int32)
    targets = np.concatenate([2 * count + used] * 2 + [2 * edges.end[used] + (edges.last[used] > 0)]).astype(np.int32)
    size = 2 * count + len(allowed)
    entries = np.concatenate([half, half + cusp, half]), (origins, targets)
    graph = scipy.sparse.coo_array(entries, shape=(size, size)).tocsr()
    goals = [2 * count - 2, 2 * count - 1]
    search = scipy.sparse.csgraph.dijkstra
    there, before, _ = search(graph, indices=[0, 1], return_predecessors=True, min_only=True)
    back = search(graph.T.tocsr(), indices=goals, min_only=True)
    vertex = goals[int(there[goals].argmin())]
    total, way = float(there[vertex]), []
    while vertex >= 2:
        vertex = int(before[vertex])
        if vertex >= 2 * count:
            way.append(vertex - 2 * count)
    reached, to_go = (costs[: 2 * count].reshape(count, 2).min(axis=1) for costs in (there, back))
    return total, way[::-1], reached[edges.start] + edges.cost + to_go[edges.end]


def _are_clear(search: BestFirstSearch, places: Array, edges: _Edges, chosen: Indices) -> BoolArray:
    arcs, curvatures, clear = _connecting_arcs(search, places, edges, chosen)
    clear[clear] = search.are_clear(places[edges.start[chosen[clear]]], arcs[clear], curvatures[clear])
    return clear


def _connecting_arcs(
    search: BestFirstSearch, places: Array, edges: _Edges, chosen: Any
) -> tuple[Array, Array, BoolArray]:
    ends = places[edges.start[chosen]], places[edges.end[chosen]]
    return search.primitives.connecting_arcs(ends[0], edges.lengths[chosen], edges.turns[chosen], ends[1])


def _arcs_of(
    search: BestFirstSearch, places: Array, edges: _Edges, way: list[int], number: Indices,
    lengths: Array, curvatures: Array,
) -> tuple[Array, Array]:  # fmt: skip
    found_lengths, found_curvatures = [], []
    for edge in way:
        if edges.own[edge]:
            piece = slice(number[edges.start[edge]], number[edges.end[edge]])
            found_lengths.append(lengths[piece])
            found_curvatures.append(curvatures[piece])
        else:
            arcs, bends, _ = _connecting_arcs(search, places, edges, [edge])
            found_lengths.append(arcs[0])
            found_curvatures.append(bends[0])
    return np.concatenate(found_lengths), np.concatenate(found_curvatures)
