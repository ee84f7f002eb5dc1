"""Best-first search of hybrid A*: poses reached by motion primitives, one kept per cell.

The search ends with an analytic expansion: a Reeds-Shepp path that is free of collisions and leads to the target.

Dolgov, Thrun, Montemerlo and Diebel, Path planning for autonomous vehicles in unknown semi-structured environments,
The International Journal of Robotics Research 29 (2010), doi:10.1177/0278364909359210.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.numerics import Array, BoolArray, Indices

from .cost_to_go import Bounds, CostToGo
from .free_space import FreeSpace, FreeSpaceWithTrailer, are_free
from .motion_primitives import COARSE_HEADINGS, MotionPrimitives

# Poses that are expanded together: array operations on a few hundred motions cost little more than on ten. As many
# Reeds-Shepp paths to the target are checked for collisions per expansion.
EXPANDED_AT_ONCE = 32
# They are looked for after each of the first expansions, later for several together: long arrays cost less than many.
OFTEN, SELDOM = 12, 6
# Every so many poses of a motion are checked first: a few decide most that collide.
STRIDE = 12


class SearchEnd(Enum):
    """Why a search ended."""

    FOUND = "There is a path."
    EXHAUSTED = "Everything that the motion primitives reach has been expanded."
    OUT_OF_BUDGET = "The time or the number of expansions ran out."


@dataclass(eq=False)
class BestFirstSearch:
    """One search: the poses reached so far from a root, their costs, and which to expand next.

    Attributes
    ----------
    root : (3,) array, or (4,) array with a trailer
        Where it begins.
    cost_to_go : CostToGo
        The heuristic, and the target.
    best_cost : float
        Of the best path so far.
    """

    root: Array
    limits: Bounds
    primitives: MotionPrimitives
    heuristic_weight: float
    space: FreeSpace | FreeSpaceWithTrailer
    cost_to_go: CostToGo
    poses: list[tuple[float, ...]] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    made_by: list[int] = field(default_factory=list)
    cost_of_cell: dict[int, float] = field(default_factory=dict)
    queue: list[tuple[float, int]] = field(default_factory=list)
    waiting: list[tuple[Indices, Array, Array, Array]] = field(default_factory=list)
    expansions: int = 0
    best_cost: float = math.inf
    last_node: int = -1
    last_arcs: tuple[Array, Array] = field(default_factory=lambda: (np.zeros(0), np.zeros(0)))

    def __post_init__(self) -> None:
        size = np.array([self.limits[0][1] - self.limits[0][0], self.limits[1][1] - self.limits[1][0]])
        self.cells = np.floor(size / self.primitives.cell).astype(int) + 1
        self.close = 1e-9 * float(size.max())
        self._add_node(tuple(self.root.tolist()), 0.0, -1, len(self.primitives.lengths), 0.0)

    def run(self, max_expansions: int, deadline: Deadline) -> SearchEnd:
        """Continue until no other path can be better than the best one, or until nothing is left or allowed.

        Parameters
        ----------
        max_expansions : int
            Of this search, those before included.
        deadline : Deadline
        """
        while self.queue and self.queue[0][0] < self.best_cost:
            if self.expansions >= max_expansions or deadline.has_passed:
                return SearchEnd.FOUND if self.last_node >= 0 else SearchEnd.OUT_OF_BUDGET
            self._expand()
            if not self.queue or self.expansions <= OFTEN or self.expansions % SELDOM == 0:
                self._expand_analytically()
        return SearchEnd.FOUND if self.last_node >= 0 else SearchEnd.EXHAUSTED

    def arcs(self) -> tuple[Array, Array]:
        """Signed lengths and curvatures of the arcs of the path found, from the root to the target."""
        lengths, curvatures = self.arcs_to(self.last_node)
        return np.concatenate([lengths, self.last_arcs[0]]), np.concatenate([curvatures, self.last_arcs[1]])

    def arcs_to(self, node: int) -> tuple[Array, Array]:
        """The same from the root to a pose that was reached."""
        made_by = []
        while self.parents[node] >= 0:
            made_by.append(self.made_by[node])
            node = self.parents[node]
        samples = self.primitives.samples
        lengths = np.repeat(self.primitives.lengths[made_by[::-1]] / samples, samples)
        return lengths, np.repeat(self.primitives.curvatures[made_by[::-1]], samples)

    def _add_node(self, pose: tuple[float, ...], cost: float, parent: int, primitive: int, rest: float) -> None:
        self.poses.append(pose)
        self.costs.append(cost)
        self.parents.append(parent)
        self.made_by.append(primitive)
        heapq.heappush(self.queue, (cost + self.heuristic_weight * rest, len(self.poses) - 1))

    def _expand(self) -> None:
        """Expand the most promising poses by all motion primitives."""
        here: list[int] = []
        while self.queue and len(here) < EXPANDED_AT_ONCE:
            here.append(heapq.heappop(self.queue)[1])
        poses, costs = np.array([self.poses[i] for i in here]), np.array([self.costs[i] for i in here])
        made_by = np.array([self.made_by[i] for i in here])
        self.expansions += 1
        self.waiting.append((np.array(here), poses, costs, made_by))
        motions = self.primitives.poses_along(poses)
        reached = costs[:, None] + np.abs(self.primitives.lengths) + self.primitives.change_cost[made_by]
        ends = motions[:, :, -1]
        cells = self._cells(ends)
        known = np.array([self.cost_of_cell.get(cell, math.inf) for cell in cells.ravel().tolist()]).reshape(
            cells.shape
        )
        node, primitive = np.nonzero((reached < known) & self.within(motions))
        if not len(node):
            return
        chosen = motions[node, primitive]
        spacings = np.full(len(node), self.primitives.spacing)
        clear = self.space.is_clear(chosen, np.abs(self.primitives.curvatures[primitive]), spacings)
        node, primitive = node[clear], primitive[clear]
        ends, reached, cells = ends[node, primitive], reached[node, primitive], cells[node, primitive]
        rests = self.cost_to_go(ends)
        for pose, cost, cell, parent, made, rest in zip(
            *(column.tolist() for column in (ends, reached, cells, node, primitive, rests)), strict=True
        ):
            if cost < self.cost_of_cell.get(cell, math.inf) and cost + rest < self.best_cost:
                self.cost_of_cell[cell] = cost
                self._add_node(tuple(pose), cost, here[parent], made, rest)

    def _cells(self, ends: Array) -> Indices:
        """Number of the cell of the end of each primitive: place, headings and direction, ``(n, b)``."""
        origin = np.array([self.limits[0][0], self.limits[1][0]])
        place = np.clip(np.floor((ends[..., :2] - origin) / self.primitives.cell).astype(int), 0, self.cells - 1)
        turn = np.rint(ends[..., 2] * (self.primitives.headings / (2.0 * np.pi))).astype(int)
        whole, turn = np.divmod(turn, self.primitives.headings)
        cell = (place[..., 0] * self.cells[1] + place[..., 1]) * self.primitives.headings + turn
        if self.primitives.whole_turns:
            cell = cell + whole * int(self.cells.prod()) * self.primitives.headings
        if ends.shape[-1] > 3:
            cell = cell * COARSE_HEADINGS + np.rint(ends[..., 3] * (COARSE_HEADINGS / (2.0 * np.pi))).astype(int)
        return np.asarray(2 * cell + (self.primitives.lengths > 0))

    def within(self, motions: Array) -> BoolArray:
        """Whether all poses of each motion are in bounds."""
        (left, right), (bottom, top) = self.limits
        x, y = motions[..., 0], motions[..., 1]
        inside = (x >= left - self.close) & (x <= right + self.close)
        inside &= (y >= bottom - self.close) & (y <= top + self.close)
        return np.asarray(inside.all(axis=-1))

    def are_clear(self, poses: Array, arcs: Array, curvatures: Array) -> BoolArray:
        """Whether each chain of arcs from its pose is in bounds and clear, ``(n,)``.

        Parameters
        ----------
        poses : (n, 3) array
        arcs, curvatures : (n, s) arrays
            Signed lengths, none longer than the spacing of the primitives; zeros fill up.
        """
        motions = self.primitives.follow(poses, arcs, curvatures)
        clear = self.within(motions)
        coarse = motions[clear, ::STRIDE]
        free = are_free(self.space, coarse.reshape(-1, motions.shape[-1]))
        clear[clear] = free.reshape(coarse.shape[:2]).all(axis=1)
        kept = np.flatnonzero(clear)
        spacings = np.full(len(kept), self.primitives.spacing)
        clear[kept] = self.space.is_clear(motions[kept], np.abs(curvatures[kept]).max(axis=1, initial=0.0), spacings)
        return clear

    def _expand_analytically(self) -> None:
        """Look for a Reeds-Shepp path to the target, from any pose that waits for it, cheaper than the best path."""
        here, poses, costs, made_by = (np.concatenate(column) for column in zip(*self.waiting, strict=True))
        checked = EXPANDED_AT_ONCE * len(self.waiting)
        self.waiting.clear()
        ahead, lengths, turns = self.primitives.paths_to(poses, self.cost_to_go.target)
        first = np.sign(first_nonzero(lengths))
        before = np.append(np.sign(self.primitives.lengths), 0.0)[made_by]
        total = ahead + costs + self.primitives.cusp_cost * (first * before < 0)
        order = np.argsort(total, axis=None, kind="stable")[:checked]
        kind, node = np.unravel_index(order[total.ravel()[order] < self.best_cost], total.shape)
        if not len(kind):
            return
        arcs, curvatures, clear = self.primitives.connecting_arcs(
            poses[node], lengths[kind, node], turns[kind], self.cost_to_go.target
        )
        clear[clear] = self.are_clear(poses[node[clear]], arcs[clear], curvatures[clear])
        if clear.any():
            winner = int(np.flatnonzero(clear)[0])
            self.best_cost = float(total[kind[winner], node[winner]])
            moves = arcs[winner] != 0.0
            self.last_node, self.last_arcs = int(here[node[winner]]), (arcs[winner][moves], curvatures[winner][moves])


def first_nonzero(lengths: Array) -> Array:
    """First of signed lengths that is not zero, ``(...)`` from ``(..., p)``."""
    first = np.zeros(lengths.shape[:-1])
    for k in reversed(range(lengths.shape[-1])):
        first = np.where(np.abs(lengths[..., k]) > 1e-9, lengths[..., k], first)
    return first
