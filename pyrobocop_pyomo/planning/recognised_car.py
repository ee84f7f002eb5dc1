"""Cars in a model, recognised by how their body moves; a path that a car can drive then leads the initial guess.

A body in the plane has three velocities in its own frame: ahead, aside, and its turn. Those of a car (bicycle,
unicycle, differential drive) satisfy one linear equation whatever its controls do: the middle of the rear axle does not
move along the axle. The equation is found from velocities at random values of everything that the phase's equations
read, so neither names nor the choice of the reference point matter.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.car_paths import CarPath, hybrid_a_star
from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.geometry import Polytope, Pose
from pyrobocop_pyomo.modeling.expression_arrays import plain_entry
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.modeling.variable_values import within_bounds
from pyrobocop_pyomo.motion.expression_values import ExpressionValues
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases import PhaseBlockData, phases_of
from pyrobocop_pyomo.phases.families import equations_by_component
from pyrobocop_pyomo.phases.horizon import horizon_fraction

logger = logging.getLogger(__name__)

Residual = Callable[[dict[str, Array]], Array]

SAMPLES = 300
# Relative to the largest velocity: what counts as zero.
NOTHING = 1e-7
# Step of difference quotients, relative to the size of a quantity.
DIFFERENCE = 1e-6
# Of the body: the radius of the turns of one that could turn on the spot, and how far beyond start and goal it may go.
SMALLEST_RADIUS = 0.5
ROOM = 3.0
FINE = 400
NEWTON_STEPS = 12


@dataclass(frozen=True, eq=False)
class RecognisedCar:
    """A body that moves like a car.

    Attributes
    ----------
    phase : PhaseBlockData
        Whose equations say how it moves.
    body : str
        Its name in the avoidance block.
    shape : Polytope
        In the car's own frame: the origin on the rear axle, x ahead.
    frame : (x, y, angle)
        The car's frame in the body's.
    turning_radius : float
    speed : float or None
        That both directions allow; None without bounds.
    """

    phase: Any
    body: str
    shape: Polytope
    frame: tuple[float, float, float]
    turning_radius: float
    speed: float | None
    _equations: _Equations

    def path(self, block: Any, clearances: float, time_limit: float) -> CarPath:
        """Path from where the body starts to where it ends, clear of all that rests.

        Parameters
        ----------
        block : ObstacleAvoidanceBlockData
            Its variables hold the start and the end.
        clearances : float
            How many of them to keep.
        time_limit : float
            Seconds.

        Raises
        ------
        InitialGuessError
            When there is none.
        """
        scene = block.record.scene
        times = self.phase.record.grid.times
        ends = [
            _placed(block.motion.pose_at_node(scene.bodies[self.body].pose, t, name=self.body), self.frame)
            for t in (times[0], times[-1])
        ]
        walls = {
            part.name: part.shape
            for pair in scene.body_pairs
            if self.body in pair
            for part in scene.parts_of(pair[0] if pair[1] == self.body else pair[1])
            if scene.is_static(part.body)
        }
        clearance = max(number for pair, number in scene.clearances.items() if self.body in pair)
        radius = self.turning_radius
        return hybrid_a_star(
            tuple(ends[0]),
            tuple(ends[1]),
            body=self.shape,
            obstacles=walls,
            wheelbase=radius,
            steering_limit=0.25 * math.pi,
            bounds=self._region(ends),
            clearance=clearances * clearance,
            time_limit=time_limit,
        )

    def _region(self, ends: Sequence[Array]) -> Any:
        """Around start and goal, within the bounds of variables that are the body's place."""
        points = np.array(ends)[:, :2]
        beyond = ROOM * self.shape.reach + 2.0 * self.turning_radius
        low, high = points.min(axis=0) - beyond, points.max(axis=0) + beyond
        offset = math.hypot(*self.frame[:2])
        for axis, name in enumerate(self._equations.place):
            if name is None:
                continue
            variable = self.phase.component(name)[self._equations.time]
            low[axis] = max(low[axis], within_bounds(-np.inf, variable) - offset)
            high[axis] = min(high[axis], within_bounds(np.inf, variable) + offset)
        low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
        return tuple(zip(low.tolist(), high.tolist(), strict=True))

    def follow(self, path: CarPath) -> bool:
        """Make the path the initial guess of the phase: its states, and controls as far as they follow from these.

        Returns
        -------
        bool
            False where the equations cannot follow; nothing is changed then.
        """
        phase, equations = self.phase, self._equations
        free = phase.component("duration")
        free = free if free is not None and free.ctype is Var and not free.fixed else None
        timing = path.timed(self.speed if self.speed is not None else 1.0)
        if self.speed is None:
            timing = path.timed(timing.duration / float(value(phase.duration)))
        duration = within_bounds(timing.duration, free) if free is not None else float(value(phase.duration))
        slower = timing.duration / duration
        times = np.linspace(0.0, timing.duration, FINE + 1)
        driven = timing.arc_length_at(times)
        poses, velocities = path.poses_at(driven), slower * timing.velocity_at(times)
        curvatures = np.tan(path.steering[path.arc_at(driven)]) / self.turning_radius
        x, y, angle = self.frame
        own = np.array([-(math.cos(angle) * x + math.sin(angle) * y), math.sin(angle) * x - math.cos(angle) * y])
        cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        turns = velocities * curvatures
        ahead, aside = velocities - turns * own[1], turns * own[0]
        target = np.column_stack([
            poses[:, 0] + cosine * own[0] - sine * own[1], poses[:, 1] + sine * own[0] + cosine * own[1],
            poses[:, 2] - angle,
        ])  # fmt: skip
        rates = np.column_stack([cosine * ahead - sine * aside, sine * ahead + cosine * aside, turns])
        found = equations.states_and_controls(target, rates, times / slower)
        if found is None or self._ends_elsewhere(found):
            return False
        fraction, shares = horizon_fraction(phase), times / timing.duration
        guesses: dict[str, Any] = {
            name: (lambda t, column=column: float(np.interp(fraction(t), shares, column)))
            for name, column in found.items()
        }
        if free is not None:
            guesses["duration"] = duration
        phase.initialize(guesses)
        return True

    def _ends_elsewhere(self, found: dict[str, Array]) -> bool:
        """Whether the end is fixed whole turns away from where the path leads."""
        for name in self._equations.pose_states:
            last = self.phase.component(name)[self.phase.record.grid.times[-1]]
            if last.fixed and abs(last.value - found[name][-1]) > 1e-6 * max(1.0, abs(last.value)):
                logger.warning(
                    "'%s' is fixed at %.6g; the path of the car leads to %.6g, which is the same heading. State "
                    "final=%.6g, or leave out whole turns of the initial value.",
                    last.name, last.value, found[name][-1], found[name][-1],
                )  # fmt: skip
                return True
        return False


class _Equations:
    """The explicit equations of a phase and the pose of a body, as functions of arrays.

    Parameters
    ----------
    block : ObstacleAvoidanceBlockData
    phase : PhaseBlockData
    body : str
    """

    def __init__(self, block: Any, phase: Any, body: str) -> None:
        record = phase.record
        self.time = time = next(iter(phase.points))
        self.rates: dict[str, Any] = {
            phase.state_name(state): plain_entry(rate)
            for statement in record.statements_of("ode")
            for state, rate in equations_by_component(record, statement.rule(phase, time), statement.name).items()
        }
        self.pose: Pose = block.motion.pose_at_node(block.record.scene.bodies[body].pose, time, name=body)
        names = [*record.names_of_states, *record.names_of_signals]
        self._variables = {name: phase.component(name)[time] for name in names}
        self._name = {id(variable): name for name, variable in self._variables.items()}
        self.pose_states = self._read(self.pose.entries)
        self.place = [
            self._name.get(id(entry)) if getattr(entry, "is_variable_type", bool)() else None
            for entry in self.pose.translation
        ]

    def _read(self, expressions: Sequence[Any]) -> list[str]:
        """Names of what expressions read of the phase, in the order of declaration."""
        found = {
            id(variable)
            for expression in expressions
            if hasattr(expression, "is_expression_type")
            for variable in variables_in(expression, include_fixed=True)
        }
        return [name for name, variable in self._variables.items() if id(variable) in found]

    def inputs(self, states: Sequence[str]) -> list[str]:
        """What the rates of some states read."""
        return self._read([self.rates[name] for name in states])

    def evaluated(self, expressions: Sequence[Any], values: dict[str, Array], count: int) -> Array:
        """Values of expressions, ``(count, len(expressions))``."""
        known = ExpressionValues({id(self._variables[name]): column for name, column in values.items()})
        return np.array([np.broadcast_to(known.of(each), count) for each in expressions], dtype=float).T

    def pose_values(self, values: dict[str, Array], count: int) -> Array:
        """x, y and angle, ``(count, 3)``."""
        return self.evaluated([*self.pose.translation, self.pose.angles[0]], values, count)

    def sampled(self, generator: np.random.Generator) -> dict[str, Array]:
        """Random values of all that matters, often at their bounds."""
        values = {}
        for name in dict.fromkeys([*self.pose_states, *self.inputs(self.pose_states)]):
            low, high = self._variables[name].bounds
            low, high = (-1.0 if high is None else high - 2.0) if low is None else low, high
            high = low + 2.0 if high is None else high
            column = generator.uniform(low, high, SAMPLES)
            if name not in self.pose_states:
                at_bound = generator.random(SAMPLES) < 0.5
                column[at_bound] = generator.choice([low, high], SAMPLES)[at_bound]
            values[name] = column
        return values

    def pose_jacobian(self, values: dict[str, Array], count: int) -> Array:
        """Derivatives of x, y and angle by the states that they read, ``(count, 3, states)``."""
        columns = []
        for name in self.pose_states:
            step = DIFFERENCE * np.maximum(1.0, np.abs(values[name]))
            ahead, behind = values | {name: values[name] + step}, values | {name: values[name] - step}
            columns.append((self.pose_values(ahead, count) - self.pose_values(behind, count)) / (2.0 * step)[:, None])
        return np.stack(columns, axis=2)

    def velocities(self, values: dict[str, Array]) -> Array:
        """Velocities of the body in its own frame, ``(samples, 3)``: along its two axes, and its turn."""
        rates = self.evaluated([self.rates[name] for name in self.pose_states], values, SAMPLES)
        world = np.einsum("kij,kj->ki", self.pose_jacobian(values, SAMPLES), rates)
        angle = self.pose_values(values, SAMPLES)[:, 2]
        cosine, sine = np.cos(angle), np.sin(angle)
        return np.column_stack([
            cosine * world[:, 0] + sine * world[:, 1], cosine * world[:, 1] - sine * world[:, 0], world[:, 2],
        ])  # fmt: skip

    def states_and_controls(self, target: Array, rates: Array, times: Array) -> dict[str, Array] | None:
        """Values over time with which the body has the poses and velocities given; None where there are none.

        States of the pose follow from the poses, then what their rates read, then what the rates of these read.
        """
        count = len(times)
        known = {name: np.full(count, float(self._variables[name].value or 0.0)) for name in self.pose_states}
        known = self._solved(self.pose_states, known, lambda values: self.pose_values(values, count) - target, count)
        error = self.pose_values(known, count) - target
        if not np.abs(error).max() <= 1e-6 * max(1.0, float(np.abs(target).max())):
            return None
        wanted: Array = np.asarray(
            np.linalg.solve(self.pose_jacobian(known, count), rates[:, :, None])[:, :, 0], dtype=np.float64
        )
        layer = self.pose_states
        while True:
            unknown = [name for name in self.inputs(layer) if name not in known]
            if not unknown:
                return known
            known |= {name: np.full(count, self._middle(name)) for name in unknown}
            known = self._solved(unknown, known, self._rates_less(layer, wanted), count)
            layer = [name for name in unknown if name in self.rates]
            wanted = np.column_stack([np.gradient(known[name], times) for name in layer]) if layer else np.zeros(0)

    def _rates_less(self, states: Sequence[str], wanted: Array) -> Callable[[dict[str, Array]], Array]:
        expressions = [self.rates[name] for name in states]
        return lambda values: self.evaluated(expressions, values, len(wanted)) - wanted

    def _middle(self, name: str) -> float:
        """A value to start from: off zero, where a car at rest would not feel its steering."""
        low, high = self._variables[name].bounds
        return within_bounds(0.0, self._variables[name]) if low is None or high is None else 0.6 * high + 0.4 * low

    def _solved(
        self, unknown: Sequence[str], values: dict[str, Array], residual: Residual, count: int
    ) -> dict[str, Array]:
        """Damped least squares for some columns, at all times at once, within the bounds of the variables."""
        for _ in range(NEWTON_STEPS):
            error = residual(values)
            columns = []
            for name in unknown:
                step = DIFFERENCE * np.maximum(1.0, np.abs(values[name]))
                columns.append((residual(values | {name: values[name] + step}) - error) / step[:, None])
            slopes = np.stack(columns, axis=2)
            gradient = np.einsum("kij,ki->kj", slopes, error)
            square = np.einsum("kij,kil->kjl", slopes, slopes)
            damping = 1e-9 * (1.0 + np.einsum("kii->k", square))
            move = np.linalg.solve(square + damping[:, None, None] * np.eye(len(unknown)), gradient[:, :, None])
            values = dict(values)
            for k, name in enumerate(unknown):
                low, high = self._variables[name].bounds
                low, high = -np.inf if low is None else low, np.inf if high is None else high
                values[name] = np.clip(values[name] - move[:, k, 0], low, high)
        return values


def recognised_car(block: Any) -> RecognisedCar | None:
    """The one body of an avoidance block that moves, where it moves like a car; None for everything else.

    Parameters
    ----------
    block : ObstacleAvoidanceBlockData
    """
    scene = block.record.scene
    moving = [name for name, body in scene.bodies.items() if body.moves and name not in scene.obstacles]
    phase = _phase_of(block)
    if phase is None or len(moving) != 1 or block.record.dimension != 2:
        return None
    try:
        return _recognised(block, phase, moving[0])
    except (PyRobocopError, KeyError, TypeError, ValueError, np.linalg.LinAlgError) as error:
        logger.debug("'%s': not taken for a car: %s", block.name, error)
        return None


def _phase_of(block: Any) -> Any:
    points = block.record.points
    home = points.parent_block() if hasattr(points, "parent_block") else None
    return home if isinstance(home, PhaseBlockData) and home in phases_of(block.model()) else None


def _recognised(block: Any, phase: Any, body: str) -> RecognisedCar | None:
    equations = _Equations(block, phase, body)
    if len(equations.pose_states) != 3 or len(equations.pose.angles) != 1:
        return None
    if not set(equations.pose_states) <= set(equations.rates):
        return None
    found = equations.velocities(equations.sampled(np.random.default_rng(0)))
    if not np.isfinite(found).all():
        return None
    axle = _axle(found)
    if axle is None:
        return None
    place, angle = axle
    place = np.where(np.abs(place) > 1e-9 * math.hypot(*place) + 1e-9, place, 0.0)
    ahead = found[:, 0] * math.cos(angle) + found[:, 1] * math.sin(angle)
    if ahead.max() < -ahead.min():
        ahead, angle = -ahead, angle + math.pi
    angle = math.remainder(round(angle, 10), 2.0 * math.pi)
    parts = [part.shape for part in block.record.scene.parts_of(body)]
    if not all(part.is_bounded for part in parts):
        return None
    corners = np.vstack([part.vertices for part in parts])
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    shape = Polytope.hull((corners - place) @ turn.T, radius=max(part.radius for part in parts), name=body)
    moves = np.abs(ahead) > 1e-3 * np.abs(ahead).max()
    radius = max(1.0 / float(np.abs(found[moves, 2] / ahead[moves]).max()), SMALLEST_RADIUS * shape.reach)
    speeds = [speed for speed in (float(ahead.max()), float(-ahead.min())) if speed > 0.0]
    return RecognisedCar(
        phase, body, shape, (float(place[0]), float(place[1]), angle), radius, min(speeds), equations
    )  # fmt: skip


def _axle(velocities: Array) -> tuple[Array, float] | None:
    """A point of the rear axle in the body's frame, and the direction ahead; None where the body is no car.

    Velocities of a car fill a plane: ``n . (ahead, aside, turn) = 0``, with the direction of the axle as the first two
    entries of n.
    """
    scale = np.abs(velocities).max(axis=0)
    if scale[:2].max() == 0.0 or scale[2] == 0.0:
        return None
    # In units in which a turn counts as much as a translation.
    weights = np.array([1.0, 1.0, scale[:2].max() / scale[2]])
    _, sizes, directions = np.linalg.svd(velocities * weights, full_matrices=False)
    normal = directions[2] * weights
    across = math.hypot(normal[0], normal[1])
    if sizes[2] > NOTHING * sizes[0] or sizes[1] < 1e-3 * sizes[0] or across < 1e-3:
        return None
    normal = normal / across
    ahead = np.array([normal[1], -normal[0]])
    return np.asarray(normal[2] * ahead), math.atan2(ahead[1], ahead[0])


def _placed(pose: Pose, frame: tuple[float, float, float]) -> Array:
    """x, y and heading of the car at a pose of the body."""
    rotation, translation = pose.numbers()
    place = rotation @ np.array(frame[:2]) + translation
    return np.array([*place, float(value(pose.angles[0])) + frame[2]])
