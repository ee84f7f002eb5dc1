"""Motion primitives of a car: the short arcs that a search is made of, their costs, and Reeds-Shepp paths.

Reeds-Shepp paths: the shortest paths of a car between two poses without obstacles; arcs, straight lines and cusps.

Reeds and Shepp, Optimal paths for a car that goes both forwards and backwards, Pacific Journal of Mathematics 145
(1990), section 8; formulas 8.1 to 8.11, doi:10.2140/pjm.1990.145.367. All functions work on arrays of
poses.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from pyrobocop_pyomo.contrib.robots.least_squares import DIFFERENCE
from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.numerics import Array, BoolArray
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE

from .car_kinematics import Trailer, follow_arc, follow_arcs, relative_pose

# ---------------------------------------------------------------------------------------------------- Reeds-Shepp paths


Formula = Callable[[Array, Array, Array], tuple[Array, Array, Array, BoolArray]]

SEGMENTS = 5
TURNS = {"L": 1.0, "S": 0.0, "R": -1.0}


def reeds_shepp_paths(x: Array, y: Array, heading: Array) -> Iterator[tuple[Array, Array, BoolArray]]:
    """All types of paths from the origin, heading along x, to poses; the turning radius is 1.

    Parameters
    ----------
    x, y, heading : (n,) arrays

    Yields
    ------
    turns : (5,) array
        1 for a left turn, 0 for a straight line, -1 for a right turn; zeros fill up.
    lengths : (n, 5) array
        Of each segment, negative where the car rolls backwards.
    exists : (n,) bool array
    """
    for formula, types, arranged, both_ends in FORMULAS:
        # Three symmetries: driven in reverse, seen in a mirror, and from the other end.
        for time, mirror, swapped in itertools.product((1.0, -1.0), (1.0, -1.0), (False, True)[: 1 + both_ends]):
            ahead = x * np.cos(heading) + y * np.sin(heading) if swapped else x
            aside = x * np.sin(heading) - y * np.cos(heading) if swapped else y
            first, middle, last, exists = formula(time * ahead, mirror * aside, time * mirror * heading)
            segments = [time * length for length in arranged(first, middle, last)]
            names = types[::-1] if swapped else types
            # Each segment's lengths side by side in memory, where all that follows reads them.
            lengths = np.zeros((SEGMENTS, len(x))).T
            for k, segment in enumerate(segments[::-1] if swapped else segments):
                lengths[:, k] = segment
            turns = np.zeros(SEGMENTS)
            turns[: len(names)] = [mirror * TURNS[name] for name in names]
            lengths[~exists] = 0.0
            yield turns, lengths, exists


def _wrapped(angle: Array) -> Array:
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def _left_straight_left(x: Array, y: Array, phi: Array) -> tuple[Array, Array, Array, BoolArray]:
    along, across = x - np.sin(phi), y - 1.0 + np.cos(phi)
    t = np.arctan2(across, along)
    v = _wrapped(phi - t)
    return t, np.hypot(along, across), v, (t >= 0) & (v >= 0)


def _left_straight_right(x: Array, y: Array, phi: Array) -> tuple[Array, Array, Array, BoolArray]:
    along, across = x + np.sin(phi), y - 1.0 - np.cos(phi)
    square = along**2 + across**2 - 4.0
    u = np.sqrt(np.maximum(square, 0.0))
    t = _wrapped(np.arctan2(across, along) + np.arctan2(2.0, u))
    v = _wrapped(t - phi)
    return t, u, v, (square >= 0) & (t >= 0) & (v >= 0)


def _left_right_left(x: Array, y: Array, phi: Array) -> tuple[Array, Array, Array, BoolArray]:
    along, across = x - np.sin(phi), y - 1.0 + np.cos(phi)
    reach = np.hypot(along, across)
    u = -2.0 * np.arcsin(np.minimum(reach / 4.0, 1.0))
    t = _wrapped(np.arctan2(across, along) + 0.5 * u + np.pi)
    return t, u, _wrapped(phi - t + u), (reach <= 4.0) & (t >= 0)


def _outer_turns(u: Array, v: Array, along: Array, across: Array, phi: Array) -> tuple[Array, Array]:
    delta = _wrapped(u - v)
    a, b = np.sin(u) - np.sin(delta), np.cos(u) - np.cos(delta) - 1.0
    angle = np.arctan2(across * a - along * b, along * a + across * b)
    other = 2.0 * (np.cos(delta) - np.cos(v) - np.cos(u)) + 3.0
    t = _wrapped(np.where(other < 0, angle + np.pi, angle))
    return t, _wrapped(t - u + v - phi)


def _four_turns_inner_opposed(x: Array, y: Array, phi: Array) -> tuple[Array, Array, Array, BoolArray]:
    along, across = x + np.sin(phi), y - 1.0 - np.cos(phi)
    rho = 0.25 * (2.0 + np.hypot(along, across))
    u = np.arccos(np.minimum(rho, 1.0))
    t, v = _outer_turns(u, -u, along, across, phi)
    return t, u, v, (rho <= 1.0) & (t >= 0) & (v <= 0)


def _four_turns_inner_alike(x: Array, y: Array, phi: Array) -> tuple[Array, Array, Array, BoolArray]:
    along, across = x + np.sin(phi), y - 1.0 - np.cos(phi)
    rho = (20.0 - along**2 - across**2) / 16.0
    u = -np.arccos(np.clip(rho, 0.0, 1.0))
    t, v = _outer_turns(u, u, along, across, phi)
    return t, u, v, (rho >= 0) & (rho <= 1.0) & (t >= 0) & (v >= 0)


def _left_right_straight_left(x: Array, y: Array, phi: Array) -> tuple[Array, Array, Array, BoolArray]:
    along, across = x - np.sin(phi), y - 1.0 + np.cos(phi)
    rho = np.hypot(along, across)
    r = np.sqrt(np.maximum(rho**2 - 4.0, 0.0))
    t = _wrapped(np.arctan2(across, along) + np.arctan2(r, -2.0))
    v = _wrapped(phi - 0.5 * np.pi - t)
    return t, 2.0 - r, v, (rho >= 2.0) & (t >= 0) & (r >= 2.0) & (v <= 0)


def _left_right_straight_right(x: Array, y: Array, phi: Array) -> tuple[Array, Array, Array, BoolArray]:
    along, across = x + np.sin(phi), y - 1.0 - np.cos(phi)
    rho, t = np.hypot(along, across), np.arctan2(along, -across)
    v = _wrapped(t + 0.5 * np.pi - phi)
    return t, 2.0 - rho, v, (rho >= 2.0) & (t >= 0) & (v <= 0)


def _left_right_straight_left_right(x: Array, y: Array, phi: Array) -> tuple[Array, Array, Array, BoolArray]:
    along, across = x + np.sin(phi), y - 1.0 - np.cos(phi)
    rho = np.hypot(along, across)
    u = 4.0 - np.sqrt(np.maximum(rho**2 - 4.0, 0.0))
    t = _wrapped(np.arctan2((4.0 - u) * along - 2.0 * across, -2.0 * along + (u - 4.0) * across))
    v = _wrapped(t - phi)
    return t, u, v, (rho >= 2.0) & (u <= 0) & (t >= 0) & (v >= 0)


QUARTER = 0.5 * np.pi

# Formula, its turns, where its three numbers go among the segments, and whether the other end gives another path.
FORMULAS: list[tuple[Formula, str, Callable[..., tuple], bool]] = [
    (_left_straight_left, "LSL", lambda t, u, v: (t, u, v), False),
    (_left_straight_right, "LSR", lambda t, u, v: (t, u, v), False),
    (_left_right_left, "LRL", lambda t, u, v: (t, u, v), True),
    (_four_turns_inner_opposed, "LRLR", lambda t, u, v: (t, u, -u, v), False),
    (_four_turns_inner_alike, "LRLR", lambda t, u, v: (t, u, u, v), False),
    (_left_right_straight_left, "LRSL", lambda t, u, v: (t, -QUARTER, u, v), True),
    (_left_right_straight_right, "LRSR", lambda t, u, v: (t, -QUARTER, u, v), True),
    (_left_right_straight_left_right, "LRSLR", lambda t, u, v: (t, -QUARTER, u, -QUARTER, v), False),
]


# ------------------------------------------------------------------------------------------------------------- vehicles


# Turning radii; with a trailer poses have one number more.
CELL, CELL_WITH_TRAILER = 0.06, 0.25
# Divisions of a turn for tables and where there is a trailer, whose angle has as many; otherwise twice as many.
COARSE_HEADINGS = 36
# With a trailer: radians that a way to a target may turn, pieces of each of its segments that get curvatures of their
# own, steps of Newton's method, and the largest change of a length.
MOST_TURNED = 2.0
PIECES, STEPS, STRETCHED = 2, 8, 0.5


@dataclass(frozen=True)
class CarSearch:
    """Resolution and costs of a search for a car's path. Lengths are in the user's unit.

    Attributes
    ----------
    cell : float or None
        Side of the squares in which one path is kept per heading and direction; None: 0.06 turning radii, 0.25
        with a trailer.
    headings : int or None
        Into how many a full turn is divided; None: 72, 36 with a trailer.
    steerings : int
        How many steering angles are tried, from one limit to the other; odd, so that straight ahead is one.
    cusp_cost : float or None
        What a change of direction costs, as a length; None: half a turning radius.
    heuristic_weight : float
        Factor of the estimated cost to go; 1 for the shortest paths, more for a faster search.
    refinements : int
        How often cells and primitives may be halved where they lead nowhere.
    max_expansions : int
        How often poses are expanded, 32 of them together, before a search is given up: the only limit that does not
        depend on the machine.
    whole_turns : bool
        Whether headings of start and goal are meant with their whole turns, so that from 0 to pi the car turns to the
        left. Otherwise a path may end at any heading that looks the same.
    """

    cell: float | None = None
    headings: int | None = None
    steerings: int = 5
    cusp_cost: float | None = None
    heuristic_weight: float = 1.5
    refinements: int = 3
    max_expansions: int = 5_000
    whole_turns: bool = False

    def __post_init__(self) -> None:
        for name in ("cell", "cusp_cost", "heuristic_weight"):
            number = getattr(self, name)
            if number is not None and not (math.isfinite(number) and number > 0.0):
                raise InitialGuessError(f"CarSearch: {name} = {number}; expected a positive number.")
        if (
            (self.headings is not None and self.headings < 8)
            or self.steerings < 3
            or self.steerings % 2 == 0
            or self.max_expansions < 1
            or self.refinements < 0
        ):
            raise InitialGuessError(
                f"CarSearch: headings = {self.headings}, steerings = {self.steerings}, max_expansions = "
                f"{self.max_expansions}; expected at least 8 headings, an odd number of steerings from 3 on, and a "
                "positive number of expansions."
            )

    def cells(self, radius: float, trailer: Trailer | None) -> tuple[float, int]:
        """Side of the squares and divisions of a turn, for a turning radius."""
        cell, headings = (CELL, 2 * COARSE_HEADINGS) if trailer is None else (CELL_WITH_TRAILER, COARSE_HEADINGS)
        return cell * radius if self.cell is None else self.cell, self.headings or headings


@dataclass(frozen=True, eq=False)
class MotionPrimitives:
    """The motion primitives of one car, their shapes and costs.

    Attributes
    ----------
    turning_radius : float
        Of the tightest turn.
    cell, headings : float and int
        Of the cells in which one path is kept.
    spacing : float
        Longest arc from one pose to the next where motions are checked.
    lengths, curvatures : (b,) arrays
        Of each primitive; negative lengths are driven backwards.
    samples : int
        Arcs into which a primitive is cut.
    cusp_cost : float
    change_cost : (b + 1, b) array
        Of one primitive after another; the last row is for the first primitive of a path.
    trailer : Trailer or None
        Poses have its angle as a fourth number.
    whole_turns : bool
        Whether paths lead to the heading of a target, not only to one that looks the same.
    """

    turning_radius: float
    cell: float
    headings: int
    spacing: float
    lengths: Array
    curvatures: Array
    samples: int
    cusp_cost: float
    change_cost: Array
    trailer: Trailer | None = None
    whole_turns: bool = False

    @classmethod
    def of(
        cls, wheelbase: float, steering_limit: float, search: CarSearch, level: int = 0, trailer: Trailer | None = None
    ) -> MotionPrimitives:
        """Primitives of a car with a given wheelbase and largest steering angle, halved `level` times."""
        radius = wheelbase / math.tan(steering_limit)
        cell, headings = search.cells(radius, trailer)
        turn = 2.0 * math.pi / headings * radius
        length = max(1.5 * cell, 1.1 * turn)  # leaves a cell, and changes the heading by one division
        length, cell, headings = length / 2**level, cell / 2**level, headings * 2**level
        samples = max(1, math.ceil(length / (0.04 * radius)))
        steer = np.linspace(-steering_limit, steering_limit, search.steerings)
        steering = np.concatenate([steer, steer])
        lengths = np.repeat([length, -length], search.steerings)
        cusp = 0.5 * radius if search.cusp_cost is None else search.cusp_cost
        change = 0.1 * radius * np.abs(steering[:, None] - steering) / (2.0 * steering_limit)
        change = change + cusp * (lengths[:, None] * lengths < 0)
        curvatures = np.tan(steering) / wheelbase
        curvatures[np.abs(curvatures) < 1e-12 / radius] = 0.0
        return cls(
            radius, cell, headings, length / samples, lengths, curvatures, samples, cusp,
            np.vstack([change, np.zeros(len(lengths))]), trailer, search.whole_turns,
        )  # fmt: skip

    def follow(self, poses: Array, lengths: Array, curvatures: Array) -> Array:
        """Poses along arcs in a row, as `follow_arcs` has them."""
        return follow_arcs(poses, lengths, curvatures, self.trailer)

    def poses_along(self, poses: Array) -> Array:
        """Poses along every primitive from each pose, ``(n, b, samples + 1, 3)``."""
        steps = np.repeat((self.lengths / self.samples)[:, None], self.samples, axis=1)
        return self.follow(poses[:, None, :], steps[None], np.repeat(self.curvatures[:, None], self.samples, 1)[None])

    def paths_to(self, poses: Array, target: Array) -> tuple[Array, Array, Array]:
        """All Reeds-Shepp paths to a target, or to one for each pose.

        With a trailer, where these would end with any angle, straight ways ahead and back that are about as long as a
        way there, for `connecting_arcs` to bend.

        Returns
        -------
        costs : (w, n) array
            Length and cusps; infinite where a type of path does not exist.
        lengths : (w, n, 5) array
            Of the segments, negative backwards.
        turns : (w, 5) array
        """
        if self.trailer is not None:
            x, y, turn = relative_pose(poses, target).T
            length = np.hypot(x, y) / np.sinc(turn / (2.0 * np.pi))
            exists = (np.abs(turn) < MOST_TURNED) & (np.abs(x) > np.abs(y))
            if self.whole_turns:
                exists &= _lead_to(poses, turn, target)
            signs = np.array([1.0, -1.0])[:, None]
            lengths = np.repeat((signs * length)[..., None] / 5.0, 5, axis=-1)
            return np.where(exists & (signs * x > 0.0), length, np.inf), lengths, np.zeros((2, 5))
        all_turns, all_lengths, all_exist = zip(*self._unit_paths(poses, target), strict=True)
        lengths, turns, exists = self.turning_radius * np.array(all_lengths), np.array(all_turns), np.array(all_exist)
        costs = np.abs(lengths).sum(axis=2) + self.cusp_cost * count_cusps(lengths)
        if self.whole_turns:
            exists &= _lead_to(poses, (lengths * turns[:, None]).sum(axis=2) / self.turning_radius, target)
        return np.where(exists, costs, np.inf), lengths, turns

    def reeds_shepp_cost(self, poses: Array, target: Array) -> Array:
        """Cost of the cheapest Reeds-Shepp path, ``(n,)``; for many poses."""
        least = np.full(len(poses), np.inf)
        for _, lengths, exists in self._unit_paths(poses, target):
            costs = self.turning_radius * np.abs(lengths).sum(axis=1) + self.cusp_cost * count_cusps(lengths)
            least = np.where(exists, np.minimum(least, costs), least)
        return least

    def _unit_paths(self, poses: Array, target: Array) -> Iterator[tuple[Array, Array, BoolArray]]:
        x, y, heading = relative_pose(poses, target).T
        return reeds_shepp_paths(x / self.turning_radius, y / self.turning_radius, heading)

    def connecting_arcs(
        self, poses: Array, lengths: Array, turns: Array, targets: Array
    ) -> tuple[Array, Array, BoolArray]:
        """Lengths and curvatures of short arcs from poses to targets, and whether these are reached.

        Parameters
        ----------
        poses : (n, 3) array
        lengths, turns : (n, 5) arrays
            As `paths_to` has them. With a trailer, lengths and curvatures are changed within their limits, as little as
            possible, until everything has the pose of the target.
        targets : (3,) or (n, 3) array

        Returns
        -------
        lengths, curvatures : (n, s) arrays
            Zeros fill up.
        reached : (n,) array
        """
        reached = np.ones(len(poses), dtype=bool)
        if self.trailer is None or not len(poses):
            return (*self._short_arcs(lengths, turns), reached)
        lengths, turns = np.repeat(lengths / PIECES, PIECES, axis=1), np.repeat(turns, PIECES, axis=1)
        pieces, most = lengths.shape[1], np.abs(self.curvatures).max() * self.turning_radius
        # Backwards small errors grow: a way back is found as the way ahead from its other end.
        back = lengths.sum(axis=1) < 0.0
        first, last = np.where(back[:, None], targets, poses), np.where(back[:, None], poses, targets)
        lengths = np.abs(lengths)
        units = np.array([self.turning_radius, self.turning_radius, 1.0, 1.0])

        def changed(points: Array) -> tuple[Array, Array]:
            bent = np.clip(turns + points[:, :pieces], -most, most)
            return lengths * (1.0 + np.repeat(points[:, pieces:], PIECES, axis=1)), bent / self.turning_radius

        def errors(along: Array) -> Array:
            apart = along[:, -1] - last
            apart[:, 2] = np.remainder(apart[:, 2] + np.pi, 2.0 * np.pi) - np.pi
            return np.asarray(apart / units)

        bound = np.repeat([2.0 * most, STRETCHED], [pieces, pieces // PIECES])
        changes = np.zeros((len(poses), len(bound)))
        for _ in range(STEPS):
            arcs = changed(changes)
            along = self.follow(first, *arcs)
            error, slopes = errors(along)[:, :, None], self._slopes(along, *arcs) / units[:, None]
            of_lengths = (slopes[..., pieces:] * lengths[:, None]).reshape(len(poses), 4, -1, PIECES).sum(axis=-1)
            # The tightest turns stay as they are.
            free = (np.abs(turns + changes[:, :pieces]) < most)[:, None] / self.turning_radius
            slopes = np.concatenate([slopes[..., :pieces] * free, of_lengths], axis=-1)
            # The smallest change that removes the error, in first order.
            square = slopes @ slopes.swapaxes(1, 2) + NEGLIGIBLE * np.eye(4)
            changes = changes - (slopes.swapaxes(1, 2) @ np.linalg.solve(square, error))[..., 0]
            changes = np.clip(changes, -bound, bound)
        lengths, turns = changed(changes)
        reached = np.abs(errors(self.follow(first, lengths, turns))).max(axis=1) <= 10 * NEGLIGIBLE
        turns = turns * self.turning_radius
        lengths[back], turns[back] = -lengths[back, ::-1], turns[back, ::-1]
        return (*self._short_arcs(lengths, turns), reached)

    def _slopes(self, along: Array, lengths: Array, curvatures: Array) -> Array:
        """Derivatives of the pose at the end of arcs by the curvature of each, then by its length: ``(n, 4, 2 s)``.

        What an arc changes is carried to the end: a turn moves all that follows, and of a change of the trailer's angle
        each later arc leaves a share.
        """
        start, end, step = along[:, :-1], along[:, 1:], DIFFERENCE * np.array([0.0, 0.0, 0.0, 1.0])
        kept = (follow_arc(start + step, lengths, curvatures, self.trailer) - end)[:, :, 3] / DIFFERENCE
        left = np.cumprod(np.append(kept[:, 1:], np.ones((len(along), 1)), axis=1)[:, ::-1], axis=1)[:, ::-1]
        slopes = []
        for moves in ((lengths, curvatures + DIFFERENCE), (lengths + DIFFERENCE, curvatures)):
            x, y, turn, angle = np.moveaxis((follow_arc(start, *moves, self.trailer) - end) / DIFFERENCE, 2, 0)
            away = along[:, -1:] - end
            slopes.append(np.stack([x - turn * away[..., 1], y + turn * away[..., 0], turn, left * angle], axis=1))
        return np.concatenate(slopes, axis=-1)

    def _short_arcs(self, lengths: Array, turns: Array) -> tuple[Array, Array]:
        """Lengths and curvatures of short arcs that make up paths of few arcs, ``(n, s)`` each; zeros fill up.

        Parameters
        ----------
        lengths, turns : (n, p) arrays
        """
        moves = np.abs(lengths) > 1e-9 * self.turning_radius
        counts = np.where(moves, np.ceil(np.abs(lengths) / self.spacing), 0.0).astype(np.int64)
        number = counts.sum(axis=1)
        most = max(int(number.max(initial=0)), 1)
        filled = np.arange(most) < number[:, None]
        arcs, curvatures = np.zeros((2, len(lengths), most))
        arcs[filled] = np.repeat((lengths / np.maximum(counts, 1)).ravel(), counts.ravel())
        curvatures[filled] = np.repeat((turns / self.turning_radius).ravel(), counts.ravel())
        return arcs, curvatures


def _lead_to(poses: Array, turned: Array, target: Array) -> BoolArray:
    """Whether turns lead to the heading of a target, its whole turns included."""
    return np.asarray(np.abs(poses[..., 2] + turned - target[..., 2]) < 1.0)


def count_cusps(lengths: Array) -> Array:
    """Number of changes of direction along signed lengths, zeros left out: ``(...)`` from ``(..., p)``."""
    count = np.zeros(lengths.shape[:-1])
    last = np.zeros(lengths.shape[:-1])
    for k in range(lengths.shape[-1]):
        sign = np.where(np.abs(lengths[..., k]) > 1e-9, np.sign(lengths[..., k]), 0.0)
        count += last * sign < 0
        last = np.where(sign == 0, last, sign)
    return count
