"""Hybrid A*: poses reached by moves of a car, one kept per cell, until a free way ends at the target.

Dolgov, Thrun, Montemerlo and Diebel, Path planning for autonomous vehicles in unknown semi-structured environments,
The International Journal of Robotics Research 29 (2010), doi:10.1177/0278364909359210.
"""

from __future__ import annotations

import heapq
import math
import time
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from .car_moves import CarMoves
from .free_space import FreeSpace
from .rolling import rolled_on
from .way_estimates import Bounds, WayEstimates

Array = NDArray[np.float64]

# Poses that are looked at together: array operations on a few hundred moves cost little more than on ten.
AT_ONCE = 32
# Free ways to the target that are judged per look.
TRIED_AT_ONCE = 16


class SearchEnd(Enum):
    """Why a search ended."""

    FOUND = "There is a path."
    USED_UP = "Everything that the moves reach has been looked at."
    OUT_OF_BUDGET = "The time or the number of poses ran out."


@dataclass(eq=False)
class OutwardSearch:
    """One search: the poses reached so far from a root, what they cost, and where to look next.

    Attributes
    ----------
    root : (3,) array
        Where it begins.
    estimates : WayEstimates
        Of the rest of the way, and the target.
    found : float
        Cost of the best path so far.
    """

    root: Array
    limits: Bounds
    moves: CarMoves
    eagerness: float
    space: FreeSpace
    estimates: WayEstimates
    poses: list[tuple[float, float, float]] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    made_by: list[int] = field(default_factory=list)
    best: dict[int, float] = field(default_factory=dict)
    queue: list[tuple[float, int]] = field(default_factory=list)
    found: float = math.inf
    found_from: int = -1
    found_steps: tuple[Array, Array] = field(default_factory=lambda: (np.zeros(0), np.zeros(0)))

    def __post_init__(self) -> None:
        size = np.array([self.limits[0][1] - self.limits[0][0], self.limits[1][1] - self.limits[1][0]])
        self.cells = np.floor(size / self.moves.cell).astype(int) + 1
        self.close = 1e-9 * float(size.max())
        self._keep((self.root[0], self.root[1], self.root[2]), 0.0, -1, len(self.moves.ways), 0.0)

    def run(self, most_nodes: int, deadline: float) -> SearchEnd:
        """Go on until a path is found that no other can be better than, or until nothing is left or allowed."""
        while self.queue and self.queue[0][0] < self.found:
            if len(self.poses) > most_nodes or time.monotonic() > deadline:
                return SearchEnd.FOUND if self.found_from >= 0 else SearchEnd.OUT_OF_BUDGET
            self._look()
        return SearchEnd.FOUND if self.found_from >= 0 else SearchEnd.USED_UP

    def steps(self) -> tuple[Array, Array]:
        """Ways and curvatures of the arcs of the path found, from the root to the target."""
        moves = []
        node = self.found_from
        while self.parents[node] >= 0:
            moves.append(self.made_by[node])
            node = self.parents[node]
        samples = self.moves.samples
        ways = np.repeat(self.moves.ways[moves[::-1]] / samples, samples)
        curvatures = np.repeat(self.moves.curvatures[moves[::-1]], samples)
        return np.concatenate([ways, self.found_steps[0]]), np.concatenate([curvatures, self.found_steps[1]])

    def _keep(self, pose: tuple[float, float, float], cost: float, parent: int, move: int, rest: float) -> None:
        self.poses.append(pose)
        self.costs.append(cost)
        self.parents.append(parent)
        self.made_by.append(move)
        heapq.heappush(self.queue, (cost + self.eagerness * rest, len(self.poses) - 1))

    def _look(self) -> None:
        """Try to end from the most promising poses, and make all moves from them."""
        here: list[int] = []
        while self.queue and len(here) < AT_ONCE:
            here.append(heapq.heappop(self.queue)[1])
        poses, costs = np.array([self.poses[i] for i in here]), np.array([self.costs[i] for i in here])
        made_by = np.array([self.made_by[i] for i in here])
        self._try_to_end(here, poses, costs, made_by)
        chains = self.moves.chains(poses)
        reached = costs[:, None] + np.abs(self.moves.ways) + self.moves.change_cost[made_by]
        ends = chains[:, :, -1]
        cells = self._cells(ends)
        best = np.array([self.best.get(cell, math.inf) for cell in cells.ravel().tolist()]).reshape(cells.shape)
        promising = (reached < best) & self._within(chains)
        node, move = np.nonzero(promising)
        if not len(node):
            return
        chosen = chains[node, move]
        spacings = np.full(len(node), self.moves.spacing)
        clear = self.space.is_clear(chosen, np.abs(self.moves.curvatures[move]), spacings)
        node, move = node[clear], move[clear]
        ends, reached, cells = ends[node, move], reached[node, move], cells[node, move]
        rest = self.estimates(ends)
        for pose, cost, cell, parent, by, still in zip(
            ends.tolist(), reached.tolist(), cells.tolist(), node.tolist(), move.tolist(), rest.tolist(), strict=True
        ):
            if cost < self.best.get(cell, math.inf) and cost + still < self.found:
                self.best[cell] = cost
                self._keep((pose[0], pose[1], pose[2]), cost, here[parent], by, still)

    def _cells(self, ends: Array) -> NDArray[np.int64]:
        """Number of the cell of the end of each move: place, heading and direction, ``(n, b)``."""
        origin = np.array([self.limits[0][0], self.limits[1][0]])
        place = np.clip(np.floor((ends[..., :2] - origin) / self.moves.cell).astype(int), 0, self.cells - 1)
        turn = np.rint(ends[..., 2] * (self.moves.headings / (2.0 * np.pi))).astype(int) % self.moves.headings
        cell = (place[..., 0] * self.cells[1] + place[..., 1]) * self.moves.headings + turn
        return np.asarray(2 * cell + (self.moves.ways > 0))

    def _within(self, chains: Array) -> NDArray[np.bool_]:
        (left, right), (bottom, top) = self.limits
        x, y = chains[..., 0], chains[..., 1]
        inside = (x >= left - self.close) & (x <= right + self.close)
        inside &= (y >= bottom - self.close) & (y <= top + self.close)
        return np.asarray(inside.all(axis=-1))

    def _try_to_end(self, here: list[int], poses: Array, costs: Array, made_by: Array) -> None:
        """Look for a free way to the target from any of these poses that is cheaper than the best path so far."""
        ahead, lengths, turns = self.moves.free_ways(poses, self.estimates.target)
        first = np.sign(_first_nonzero(lengths))
        before = np.append(np.sign(self.moves.ways), 0.0)[made_by]
        total = ahead + costs + self.moves.cusp_cost * (first * before < 0)
        order = np.argsort(total, axis=None, kind="stable")[:TRIED_AT_ONCE]
        word, node = np.unravel_index(order[total.ravel()[order] < self.found], total.shape)
        if not len(word):
            return
        steps = [self.moves.steps_along(lengths[w, n], turns[w]) for w, n in zip(word, node, strict=True)]
        most = max(len(ways) for ways, _ in steps)
        ways, curvatures = np.zeros((2, len(steps), max(most, 1)))
        for k, (way, curvature) in enumerate(steps):
            ways[k, : len(way)], curvatures[k, : len(way)] = way, curvature
        chains = rolled_on(poses[node], ways, curvatures)
        kept = np.flatnonzero(self._within(chains))
        clear = self.space.is_clear(
            chains[kept], np.abs(curvatures[kept]).max(axis=1), np.full(len(kept), self.moves.spacing)
        )
        if clear.any():
            winner = kept[np.flatnonzero(clear)[0]]
            self.found = float(total[word[winner], node[winner]])
            self.found_from, self.found_steps = here[node[winner]], steps[winner]


def _first_nonzero(lengths: Array) -> Array:
    first = np.zeros(lengths.shape[:-1])
    for k in reversed(range(lengths.shape[-1])):
        first = np.where(np.abs(lengths[..., k]) > 1e-9, lengths[..., k], first)
    return first
