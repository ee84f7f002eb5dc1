"""The configurations of a phase: values of the states that pose rules read, and which of them are clear.

Poses are functions of arrays, so that many configurations are looked at together. A coordinate is measured by how far
it moves the corners of the shapes: metres of one joint count as metres of another.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.geometry.distance import TOUCHING
from pyrobocop_pyomo.geometry.nearest_points import nearest_differences
from pyrobocop_pyomo.modeling.blocks import blocks_of_kind
from pyrobocop_pyomo.modeling.expression_nodes import ARRAY_FUNCTIONS
from pyrobocop_pyomo.modeling.expression_steps import ExpressionSteps
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.numerics import Array, BoolArray
from pyrobocop_pyomo.numerics.rounding import MET
from pyrobocop_pyomo.obstacles.avoidance_block import ObstacleAvoidanceBlockData
from pyrobocop_pyomo.obstacles.rerouting import InnerAndOuterBall
from pyrobocop_pyomo.obstacles.scene import ConvexPart

from .least_squares import damped_least_squares

# Random configurations: for the size of a coordinate, and for solutions of rows at one end of the phase.
SAMPLES, CANDIDATES, MOST_ENDS = 64, 300, 8
# Corners of unbounded shapes are that many times the size of the scene away.
FAR = 1e3


@dataclass(frozen=True)
class EndRows:
    """Rows of the model that read configurations at one time only.

    Attributes
    ----------
    bodies : callable
        Values (k, m) at points (k, n).
    low, high : (m,) arrays
    """

    bodies: Callable[[Array], Array]
    low: Array
    high: Array

    def violations(self, points: Array) -> Array:
        """By how much points (k, n) violate each row, with a sign, (k, m)."""
        found = self.bodies(points)
        return np.asarray(found - np.clip(found, self.low, self.high))

    def hold(self, points: Array) -> BoolArray:
        """At which of the points (k, n) all rows hold, (k,)."""
        size = np.maximum(1.0, np.where(np.isfinite(self.low), np.abs(self.low), np.abs(self.high)))
        return np.asarray((np.abs(self.violations(points)) <= MET * size).all(axis=1))


class ConfigurationSpace:
    """The configurations of a phase.

    Parameters
    ----------
    phase : PhaseBlockData
        Its values are an initial guess.

    Attributes
    ----------
    names : list of str
        The states that poses read, in the order of declaration.
    low, high : (n,) arrays
        What is searched: their bounds, or the surroundings of the guess where they have none.
    lengths : (n,) array
        How far a unit of each coordinate moves a corner at most.
    spacing : float
        In lengths: how close two configurations on a line are so that no obstacle is missed in between.

    Raises
    ------
    InitialGuessError
        Where no pose reads a state of the phase, or its poses are no rotations.
    """

    def __init__(self, phase: Any) -> None:
        self.phase, self.label = phase, f"phase '{phase.name}'"
        self._times = (phase.time.first(), phase.time.last())
        points = {id(phase.points), id(phase.time)}
        self.blocks = [
            block for block in blocks_of_kind(phase.model(), ObstacleAvoidanceBlockData)
            if id(block.record.points) in points
        ]  # fmt: skip
        self.names = self._states_read()
        if not self.names:
            raise InitialGuessError(f"{self.label}: no pose of an obstacle avoidance block reads a state of it.")
        self._variables = {t: self._at(t) for t in self._times}
        self._place_shapes()
        self.low, self.high = self._region()
        self.lengths = self._measured()
        self.spacing = self._fine_enough()
        self._rows = self._rows_at_the_ends()
        self._asked = self._clearances

    # ---------------------------------------------------------------- what there is

    def _at(self, t: float) -> list[Any]:
        return [self.phase.component(name)[t] for name in self.names]

    def _poses(self, t: float) -> dict[tuple[int, str], Any]:
        """Poses of all bodies that move, by block and name."""
        return {
            (k, name): block.motion.pose_at_node(body.pose, t, name=name)
            for k, block in enumerate(self.blocks)
            for name, body in block.record.scene.bodies.items()
            if body.moves
        }

    def _states_read(self) -> list[str]:
        t = self._times[0]
        states = {name: self.phase.component(name)[t] for name in self.phase.record.names_of_states}
        return names_read([entry for pose in self._poses(t).values() for entry in pose.entries], states)

    def _place_shapes(self) -> None:
        """Functions for the poses, corners of all shapes as one array, and the pairs of shapes that are kept apart.

        What moves by itself in time is left out: it has no place in a configuration.
        """
        poses = [self._poses(t) for t in self._times]
        lines = [
            _columns_of([entry for pose in found.values() for entry in pose.entries], self._variables[t])
            for t, found in zip(self._times, poses, strict=True)
        ]
        self._line, self._bodies = lines[0], list(poses[0])
        dimension = self.blocks[0].record.dimension
        somewhere = np.random.default_rng(0).uniform(-1.0, 1.0, (3, len(self.names)))
        first, last = (line(somewhere) for line in lines)
        size = dimension * (dimension + 1)
        alike = np.isclose(first, last, rtol=1e-9, atol=1e-9).reshape(-1, size)
        agree: BoolArray = np.asarray(alike.reshape(len(first), -1, size).all(axis=(0, 2)))
        turns = first.reshape(3, -1, size)[:, :, : dimension**2].reshape(3, -1, dimension, dimension)
        if not np.allclose(turns @ turns.transpose(0, 1, 3, 2), np.eye(dimension), atol=1e-6):
            raise InitialGuessError(
                f"{self.label}: its poses are rotations at some values of {', '.join(self.names)} only, as those of "
                "quaternions are. Random values of these are no configurations."
            )
        on_clock = {body for body, same in zip(self._bodies, agree.tolist(), strict=True) if not same}
        parts: dict[tuple[int, str], tuple[int, ConvexPart]] = {}
        pairs, clearances = [], []
        for k, block in enumerate(self.blocks):
            scene = block.record.scene
            for pair, clearance in scene.clearances.items():
                if any((k, body) in on_clock for body in pair):
                    continue
                for a in scene.parts_of(pair[0]):
                    for b in scene.parts_of(pair[1]):
                        for part in (a, b):
                            parts.setdefault((k, part.name), (k, part))
                        pairs.append(((k, a.name), (k, b.name)))
                        clearances.append(clearance + a.shape.radius + b.shape.radius)
        if not pairs:
            raise InitialGuessError(f"{self.label}: nothing that rests in time is to be kept clear of.")
        number = {name: position for position, name in enumerate(parts)}
        self._parts = list(parts.values())
        self._pairs = np.array([[number[a], number[b]] for a, b in pairs])
        self._clearances = np.array(clearances)
        self._radii = np.array([part.shape.radius for _, part in self._parts])
        everything = np.vstack([part.shape.covering for _, part in self._parts])
        self._extent = float(np.linalg.norm(np.ptp(everything, axis=0)))
        corners = [self._corners_of(part) for _, part in self._parts]
        count = max(map(len, corners))
        # All shapes get as many: the first corner is repeated.
        self._corners = np.array([np.vstack([each, *[each[:1]] * (count - len(each))]) for each in corners])
        self._balls = 0.5 * (self._corners.min(axis=1) + self._corners.max(axis=1))
        self._outer = np.linalg.norm(self._corners - self._balls[:, None], axis=2).max(axis=1)
        order = {body: position for position, body in enumerate(self._bodies)}
        self._body_of = np.array([order.get((k, part.body), -1) for k, part in self._parts])

    def _corners_of(self, part: ConvexPart) -> Array:
        """Corners of a shape, and far ones for its rays."""
        corners, rays = part.shape.covering, part.shape.rays
        away = (*rays, rays.sum(axis=0)) if len(rays) else ()
        return np.vstack([corners, *(corners[:1] + FAR * self._extent * ray for ray in away)])

    def _region(self) -> tuple[Array, Array]:
        """Bounds of the coordinates; where there are none, a turn around the ends or as far as the scene is large."""
        low, high = np.empty(len(self.names)), np.empty(len(self.names))
        middle = self._at(self.phase.points.at(len(self.phase.points) // 2 + 1))
        guess = self.guess()
        for k, variable in enumerate(middle):
            bounds = variable.bounds
            beyond = np.pi if self._is_angle(k) else self._extent
            low[k] = guess[:, k].min() - beyond if bounds[0] is None else bounds[0]
            high[k] = guess[:, k].max() + beyond if bounds[1] is None else bounds[1]
        return np.minimum(low, guess[[0, -1]].min(axis=0)), np.maximum(high, guess[[0, -1]].max(axis=0))

    def _is_angle(self, k: int) -> bool:
        """Whether a full turn of a coordinate changes no pose."""
        points = np.random.default_rng(1).uniform(-1.0, 1.0, (3, len(self.names)))
        turned = points.copy()
        turned[:, k] += 2.0 * np.pi
        return bool(np.allclose(self._line(points), self._line(turned), atol=1e-9))

    def guess(self) -> Array:
        """The configurations of the initial guess, (k, n).

        Raises
        ------
        InitialGuessError
            Where a state has no value.
        """
        times = list(self.phase.time)
        found = [[variable.value for variable in self._at(t)] for t in times]
        if any(number is None for row in found for number in row):
            raise InitialGuessError(f"{self.label}: not all of {', '.join(self.names)} have an initial guess.")
        return np.array(found, dtype=float)

    def _measured(self) -> Array:
        points = np.random.default_rng(2).uniform(self.low, self.high, (SAMPLES, len(self.names)))
        moves = self._body_of >= 0
        here, lengths = self.placed(points)[:, moves], []
        for k in range(len(self.names)):
            step = 1e-4 * max(1.0, float(np.abs(points[:, k]).max()))
            moved = points.copy()
            moved[:, k] += step
            lengths.append(float(np.linalg.norm(self.placed(moved)[:, moves] - here, axis=3).max()) / step)
        return np.maximum(lengths, 1e-3 * max(lengths))

    def _fine_enough(self) -> float:
        """Twice the clearance, and half of the inner ball of the thinnest shape that moves."""
        inner = min(
            InnerAndOuterBall.of(part.shape).inner
            for (_, part), body in zip(self._parts, self._body_of.tolist(), strict=True) if body >= 0
        )  # fmt: skip
        clearance = float((self._clearances - self._radii[self._pairs].sum(axis=1)).min())
        return max(2.0 * clearance + 0.5 * inner, 1e-3 * self._extent)

    def _rows_at_the_ends(self) -> dict[float, EndRows | None]:
        """Rows of the model that read nothing but the configuration at one end."""
        known = {id(variable): t for t in self._times for variable in self._variables[t]}
        rows_by_time: dict[float, list[Any]] = {t: [] for t in self._times}
        separate = {id(block) for block in self.blocks}
        for row in self.phase.model().component_data_objects(Constraint, active=True, descend_into=True):
            if id(row.parent_block()) in separate:
                continue
            times = {known.get(id(variable)) for variable in variables_in(row.body, include_fixed=False)}
            if len(times) == 1 and (t := times.pop()) is not None:
                rows_by_time[t].append(row)
        return {
            t: None if not rows else EndRows(
                _columns_of([row.body for row in rows], self._variables[t]),
                np.array([-np.inf if row.lower is None else value(row.lower) for row in rows], dtype=float),
                np.array([np.inf if row.upper is None else value(row.upper) for row in rows], dtype=float),
            )
            for t, rows in rows_by_time.items()
        }  # fmt: skip

    # ---------------------------------------------------------------- distances

    def placed(self, points: Array) -> Array:
        """Corners of all shapes at configurations (k, n): (k, shapes, corners, d)."""
        return self._moved(points, self._corners)

    def _moved(self, points: Array, corners: Array) -> Array:
        d = corners.shape[2]
        poses = self._line(points).reshape(len(points), -1, d * (d + 1))
        moved = np.broadcast_to(corners, (len(points), *corners.shape)).copy()
        moves = self._body_of >= 0
        own = poses[:, self._body_of[moves]]
        turns, places = own[:, :, : d * d].reshape(*own.shape[:2], d, d), own[:, :, d * d :]
        moved[:, moves] = np.einsum("kpij,pvj->kpvi", turns, corners[moves]) + places[:, :, None]
        return moved

    def _apart(self, points: Array, least: Array, beyond: Array) -> Array:
        """Distances (k, pairs) of the shapes of all pairs without radii.

        Minus infinity where they are less than `least` of the pair; some number that is no less than `beyond` where
        they are proven to be no less.
        """
        first, second = self._pairs.T
        balls = self._moved(points, self._balls[:, None])[:, :, 0]
        apart = np.linalg.norm(balls[:, first] - balls[:, second], axis=2) - self._outer[first] - self._outer[second]
        distances = np.broadcast_to(beyond, apart.shape).copy()
        point, pair = np.nonzero(apart < beyond)
        if len(point):
            corners = self.placed(points)
            p, q = corners[point, first[pair]], corners[point, second[pair]]
            origin = 0.5 * (p[:, :1] + q[:, :1])
            p, q = p - origin, q - origin
            scale = np.maximum(np.abs(p).max(axis=(1, 2)), np.abs(q).max(axis=(1, 2)))
            nearest = nearest_differences(p, q, scale, np.maximum(least[pair], TOUCHING * scale), beyond[pair])
            between = np.linalg.norm(nearest, axis=1)
            distances[point, pair] = np.where(np.isnan(between), -np.inf, between)
        return distances

    def are_clear(self, points: Array) -> BoolArray:
        """Which configurations (k, n) keep everything apart as asked, (k,)."""
        if not len(points):
            return np.zeros(0, dtype=bool)
        return np.asarray((self._apart(points, self._asked, self._asked) >= self._asked).all(axis=1))

    def require_clearances(self, clearances: float, ends: Array) -> None:
        """How many clearances to keep; a pair that has less room at one of the ends (k, n) keeps what it has there."""
        radii = self._radii[self._pairs].sum(axis=1)
        wanted = radii + clearances * (self._clearances - radii)
        room = self._apart(ends, np.zeros(len(wanted)), wanted).min(axis=0) - MET * self._extent
        self._asked = np.minimum(wanted, room)

    # ---------------------------------------------------------------- ends

    def guess_reaches_goals_clear(self) -> bool:
        """Whether the initial guess is clear at all points, and rows at its ends hold."""
        return self.guess_reaches_goals() and bool(self._keep_required_clearances(self.guess()).all())

    def guess_reaches_goals(self) -> bool:
        """Whether the rows at both ends hold at the initial guess."""
        guess = self.guess()
        ends = zip((0, -1), self._rows.values(), strict=True)
        return all(rows is None or bool(rows.hold(guess[[k]])[0]) for k, rows in ends)

    def ends(self, is_last: bool, near: Array, generator: np.random.Generator) -> Array:
        """Clear configurations (k, n) where the phase may start or end, those nearest to a configuration first.

        Coordinates that are fixed stay. If others are not, rows of the model at that time are solved for them, from the
        initial guess and from random configurations.

        Raises
        ------
        InitialGuessError
            Where there are none, with the body pair that is too close.
        """
        t = self._times[is_last]
        variables, rows = self._variables[t], self._rows[t]
        guess = self.guess()[-1 if is_last else 0]
        free = np.array([not variable.fixed for variable in variables])
        low = np.array([self.low[k] if v.fixed or v.lb is None else v.lb for k, v in enumerate(variables)])
        high = np.array([self.high[k] if v.fixed or v.ub is None else v.ub for k, v in enumerate(variables)])
        configurations = guess[None]
        if free.any():
            some = np.tile(guess, (CANDIDATES, 1))
            some[1:, free] = generator.uniform(low[free], high[free], (CANDIDATES - 1, int(free.sum())))
            configurations = some if rows is None else self._solved(rows, some, free, low, high)
            if rows is None and (self._keep_required_clearances(guess[None])).all():
                configurations = guess[None]
        clear = configurations[self._keep_required_clearances(configurations)]
        if not len(clear):
            end = "end" if is_last else "start"
            raise InitialGuessError(
                f"{self.label}: no clear configuration for its {end} was found, of {', '.join(self.names)}: "
                f"{self._what_is_close(configurations)}. Check that one exists which keeps every clearance, or give "
                f"the {end} as values of these states."
            )
        configurations = clear
        order = np.argsort(np.linalg.norm((configurations - near) * self.lengths, axis=1), kind="stable")
        kept = configurations[order[:1]]
        for each in configurations[order]:
            # Most random configurations lead to the same few solutions.
            if np.linalg.norm((kept - each) * self.lengths, axis=1).min() > self.spacing and len(kept) < MOST_ENDS:
                kept = np.vstack([kept, each])
        return np.asarray(kept)

    def _what_is_close(self, points: Array) -> str:
        """The body pairs without their clearance, in the one of these configurations (k, n) with the fewest."""
        if not len(points):
            return "no values within their bounds meet the rows of the model there"
        close = self._apart(points, self._asked, self._asked) < self._asked
        fewest = close[close.sum(axis=1).argmin()]
        pairs = [" and ".join(f"'{self._parts[k][1].body}'" for k in pair) for pair in self._pairs[fewest]]
        return f"at best, {', '.join(dict.fromkeys(pairs))} are too close there"

    def _keep_required_clearances(self, points: Array) -> BoolArray:
        self._asked = self._clearances - MET * self._extent
        return self.are_clear(points)

    def _solved(self, rows: EndRows, points: Array, free: BoolArray, low: Array, high: Array) -> Array:
        def whole(unknown: Array) -> Array:
            solutions = points.copy()
            solutions[:, free] = unknown
            return solutions

        def residual(unknown: Array) -> Array:
            return rows.violations(whole(unknown))

        solutions = whole(damped_least_squares(residual, points[:, free], low[free], high[free]))
        return solutions[rows.hold(solutions)]


def names_read(expressions: Sequence[Any], variables: Mapping[str, Any]) -> list[str]:
    """Names of the variables that expressions read, in the order of the variables."""
    read = {
        id(variable)
        for expression in expressions
        if hasattr(expression, "is_expression_type")
        for variable in variables_in(expression, include_fixed=True)
    }
    return [name for name, variable in variables.items() if id(variable) in read]


def _columns_of(expressions: Sequence[Any], variables: Sequence[Any]) -> Callable[[Array], Array]:
    """Expressions as a function of points (k, n) that gives their values, (k, m)."""
    steps = ExpressionSteps(expressions)
    return lambda points: columns_of(steps, dict(zip(map(id, variables), points.T, strict=True)), len(points))


def columns_of(steps: ExpressionSteps, leaves: Mapping[int, Array], count: int) -> Array:
    """Values of expressions, ``(count, expressions)``, from values of their variables, ``(count,)``, by identity."""
    values = steps.evaluate_at(leaves, ARRAY_FUNCTIONS)
    return np.array([np.broadcast_to(each, count) for each in values], dtype=float).reshape(-1, count).T
