"""Cars in a model, recognised by how their body moves; a path that a car can drive then leads the initial guess.

A body in the plane has three velocities in its own frame: ahead, aside, and its turn. Those of a car (bicycle,
unicycle, differential drive) satisfy one linear equation whatever its controls do: the middle of the rear axle does not
move along the axle. The equation is found from velocities at random values of everything that the phase's equations
read, so neither names nor the choice of the reference point matter.

A trailer has an axle as well. It is the car's where one point of the car is a point of the trailer in all poses, the
hitch. Of the two, the car is the one whose velocities in its own frame do not depend on the poses.
"""

from __future__ import annotations

import contextlib
import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pyomo.core.base.constraint import ConstraintData
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.contrib.robots.least_squares import DIFFERENCE
from pyrobocop_pyomo.contrib.robots.sampled_path import functions_of_time_index
from pyrobocop_pyomo.errors import InitialGuessError, ObstacleError, PyRobocopError
from pyrobocop_pyomo.geometry import Polytope, Pose, planar_pose, signed_distance
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.expression_arrays import plain_entry
from pyrobocop_pyomo.modeling.variable_values import within_bounds
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases import PhaseBlockData, phases_of

from .car_kinematics import Trailer, placed
from .car_path import CarPath
from .cost_to_go import bounds_around
from .inverse_dynamics import SAMPLES, InverseDynamics
from .motion_primitives import CarSearch
from .staged_search import ROOM, staged_search

logger = logging.getLogger(__name__)

# Relative to the largest velocity: what counts as zero.
NOTHING = 1e-7
# Of the body: the radius of the turns of one that could turn on the spot.
SMALLEST_RADIUS = 0.5
# Angles of a trailer, to either side, that are compared with bounds and rows.
ANGLES = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 181)

Frame = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class RecognisedCar:
    """A body that moves like a car, and another one that it may pull.

    Attributes
    ----------
    phase : PhaseBlockData
        Whose equations say how it moves.
    bodies : list of str
        Names of the car, and of the trailer, in the avoidance block.
    shape : Polytope
        In the car's own frame: the origin on the rear axle, x ahead.
    frames : list of (x, y, angle)
        The frames of car and trailer in the frames of their bodies.
    turning_radius : float
    speed : float or None
        That both directions allow; None without bounds.
    trailer : Trailer or None
    """

    phase: Any
    bodies: list[str]
    shape: Polytope
    frames: list[Frame]
    turning_radius: float
    speed: float | None
    trailer: Trailer | None
    _equations: InverseKinematics

    def path(self, block: Any, clearances: float, time_limit: float | None) -> CarPath:
        """Path from where the bodies start to where they end, clear of all that rests; with its whole turns if it can.

        Parameters
        ----------
        block : ObstacleAvoidanceBlockData
            Its variables hold the start and the end.
        clearances : float
            How many of them to keep.
        time_limit : float or None
            Seconds.

        Raises
        ------
        InitialGuessError
            When there is none.
        """
        scene = block.record.scene
        times = self.phase.record.grid.times
        ends = []
        for t in (times[0], times[-1]):
            placed = [
                _placed(block.motion.pose_at_node(scene.bodies[body].pose, t, name=body), frame)
                for body, frame in zip(self.bodies, self.frames, strict=True)
            ]
            ends.append(np.append(placed[0], [there[2] - placed[0][2] for there in placed[1:]]))
        walls = {
            part.name: part.shape
            for pair in scene.clearances
            if not set(self.bodies).isdisjoint(pair)
            for body in pair
            for part in scene.parts_of(body)
            if scene.is_static(part.body)
        }
        clearance = max(number for pair, number in scene.clearances.items() if not set(self.bodies).isdisjoint(pair))
        deadline = Deadline.after(time_limit)

        def search(*, whole_turns: bool) -> CarPath:
            path, _, _ = staged_search(
                tuple(ends[0]),
                tuple(ends[1]),
                body=self.shape,
                obstacles=walls,
                wheelbase=self.turning_radius,
                steering_limit=0.25 * math.pi,
                regions=[self._region(ends, room) for room in ROOM],
                clearance=clearances * clearance,
                search=CarSearch(whole_turns=whole_turns),
                time_limit=deadline.left,
                trailer=self.trailer,
            )
            return path

        path = search(whole_turns=False)
        last = (self.phase.component(name)[times[-1]] for name in self._equations.pose_states)
        if any(variable.fixed for variable in last) and abs(path.poses[-1, 2] - ends[1][2]) > 1.0:
            # The path that is easiest to find turns the other way: what is fixed says which way it has to be.
            with contextlib.suppress(InitialGuessError):
                path = search(whole_turns=True)
        return path

    def _region(self, ends: Sequence[Array], room: float) -> Any:
        """Around start and goal, within the bounds of variables that are the body's place."""
        points = np.array(ends)[:, :2]
        behind = 0.0 if self.trailer is None else self.trailer.length
        low, high = np.array(bounds_around(points, room * self.shape.reach + 2.0 * (self.turning_radius + behind))).T
        offset = math.hypot(*self.frames[0][:2])
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
        phase = self.phase
        timing = path.timed(self.speed if self.speed is not None else 1.0)
        if self.speed is None:
            timing = path.timed(timing.duration / float(value(phase.duration)))
        times, poses, steering, velocities, _, duration = path.over_phase(phase, timing)
        turns = velocities * np.tan(steering) / self.turning_radius
        motions = [_of_body(poses, velocities, turns, self.frames[0])]
        if self.trailer is not None:
            of_trailer = self.trailer.velocities(poses[:, 3], velocities, turns)
            motions.append(_of_body(self.trailer.poses(poses), *of_trailer, self.frames[1]))
        target, rates = (np.concatenate(columns, axis=1) for columns in zip(*motions, strict=True))
        found = self._equations.states_and_controls(target, rates, times)
        if found is None or self._ends_elsewhere(found):
            return False
        phase.initialize(functions_of_time_index(phase, found) | duration)
        return True

    def _ends_elsewhere(self, guess: dict[str, Array]) -> bool:
        """Whether the end is fixed whole turns away from where the path leads."""
        for name in self._equations.pose_states:
            last = self.phase.component(name)[self.phase.record.grid.times[-1]]
            if last.fixed and abs(last.value - guess[name][-1]) > 1e-6 * max(1.0, abs(last.value)):
                logger.warning(
                    "'%s' is fixed at %.6g; the path of the car leads to %.6g, which is the same heading. State "
                    "final=%.6g, or leave out whole turns of the initial value.",
                    last.name, last.value, guess[name][-1], guess[name][-1],
                )  # fmt: skip
                return True
        return False


def recognised_car(block: Any) -> RecognisedCar | None:
    """The one body that moves, where it moves like a car, or the two that do, where they are a car and its trailer.

    Parameters
    ----------
    block : ObstacleAvoidanceBlockData

    Returns
    -------
    RecognisedCar or None
        None for everything else; the log says why.
    """
    scene = block.record.scene
    moving = [name for name, body in scene.bodies.items() if body.moves and name not in scene.obstacles]
    phase = _phase_of(block)
    if phase is None or len(moving) not in (1, 2) or block.record.dimension != 2:
        return None
    try:
        return _recognised(block, phase, moving)
    except (PyRobocopError, KeyError, TypeError, ValueError, np.linalg.LinAlgError) as error:
        logger.info("'%s': %s not taken for a car: %s", block.name, " and ".join(map(repr, moving)), error)
        return None


def _phase_of(block: Any) -> Any:
    points = block.record.points
    home = points.parent_block() if hasattr(points, "parent_block") else None
    return home if isinstance(home, PhaseBlockData) and home in phases_of(block.model()) else None


def _recognised(block: Any, phase: Any, bodies: list[str]) -> RecognisedCar:
    """A car, with a trailer where there are two bodies.

    Raises
    ------
    ObstacleError
        When they are none; says what is missing.
    """
    equations = InverseKinematics(block, phase, bodies)
    if not all(pose.angles for pose in equations.poses) or len(equations.pose_states) != 2 + len(bodies):
        raise ObstacleError(
            f"the poses read {equations.pose_states}; expected {2 + len(bodies)} states: a position, and a heading for "
            "each body."
        )
    if not set(equations.pose_states) <= set(equations.rates):
        raise ObstacleError("the poses read states without an explicit differential equation.")
    generator = np.random.default_rng(0)
    values = equations.sampled(equations.pose_states, generator)
    moved = equations.sampled(equations.pose_states, generator)
    elsewhere = {name: moved[name] for name in equations.pose_states}
    velocities, others = equations.velocities(values), equations.velocities(values | elsewhere)
    if not np.isfinite(velocities).all():
        raise ObstacleError("their velocities are not finite.")
    frames = [_frame(body, velocities[:, k]) for k, body in enumerate(bodies)]
    hitch = length = 0.0
    if len(bodies) == 2:
        pulls = np.abs(others - velocities).max(axis=(0, 2)) <= NOTHING * np.abs(velocities).max()
        if pulls.all() or not pulls.any():
            raise ObstacleError("velocities of just one of them, the car, must not depend on the poses.")
        if pulls[1]:
            return _recognised(block, phase, bodies[::-1])
        frames, hitch, length = _hitched(frames, equations.pose_values(values, len(velocities)))
    x, y, angle = frames[0]
    ahead = velocities[:, 0, 0] * math.cos(angle) + velocities[:, 0, 1] * math.sin(angle)
    ahead = ahead - velocities[:, 0, 2] * (y * math.cos(angle) - x * math.sin(angle))
    shapes = [_in_frame(block, body, frame) for body, frame in zip(bodies, frames, strict=True)]
    moves = np.abs(ahead) > 1e-3 * np.abs(ahead).max()
    radius = max(1.0 / float(np.abs(velocities[moves, 0, 2] / ahead[moves]).max()), SMALLEST_RADIUS * shapes[0].reach)
    speeds = [speed for speed in (float(ahead.max()), float(-ahead.min())) if speed > 0.0]
    trailer = None
    if len(bodies) == 2:
        trailer = Trailer(shapes[1], hitch, length, ANGLES[-1])
        trailer = replace(trailer, limit=_limit(block, phase, equations, frames, shapes[0], trailer))
    return RecognisedCar(phase, bodies, shapes[0], frames, radius, min(speeds), trailer, equations)


def _frame(body: str, velocities: Array) -> Frame:
    """The frame of a car in the frame of its body: on its rear axle, x ahead."""
    axle = _axle(velocities)
    if axle is None:
        raise ObstacleError(f"'{body}' has no axle that never moves along itself.")
    place, angle = axle
    place = np.where(np.abs(place) > 1e-9 * math.hypot(*place) + 1e-9, place, 0.0)
    ahead = velocities[:, 0] * math.cos(angle) + velocities[:, 1] * math.sin(angle)
    angle += math.pi if ahead.max() < -ahead.min() else 0.0
    return float(place[0]), float(place[1]), math.remainder(round(angle, 10), 2.0 * math.pi)


def _in_frame(block: Any, body: str, frame: Frame) -> Polytope:
    parts = [part.shape for part in block.record.scene.parts_of(body)]
    if not all(part.is_bounded for part in parts):
        raise ObstacleError(f"'{body}' is not bounded.")
    corners = np.vstack([part.covering for part in parts])
    turn = np.array([[math.cos(frame[2]), -math.sin(frame[2])], [math.sin(frame[2]), math.cos(frame[2])]])
    return Polytope.hull((corners - frame[:2]) @ turn, radius=max(part.radius for part in parts), name=body)


def _hitched(frames: list[Frame], poses: Array) -> tuple[list[Frame], float, float]:
    """Frames of car and trailer with the hitch on their x axes, and where it is there: ahead of each axle.

    Parameters
    ----------
    frames : list of (x, y, angle)
        On the axles; where along them, nothing tells yet.
    poses : (n, 6) array
        Of both bodies.

    Raises
    ------
    ObstacleError
        When no point of one is a point of the other in all poses.
    """
    rows, places = [], []
    for (*place, angle), own in zip(frames, (poses[:, :3], poses[:, 3:]), strict=True):
        places.append(placed(own, np.array([place]))[:, 0].T.ravel())
        cosine, sine = np.cos(own[:, 2] + angle), np.sin(own[:, 2] + angle)
        rows.append(np.concatenate([np.column_stack([cosine, -sine]), np.column_stack([sine, cosine])]))
    matrix, wanted = np.hstack([rows[0], -rows[1]]), places[1] - places[0]
    hitch = np.linalg.lstsq(matrix, wanted, rcond=None)[0]
    apart = float(np.abs(matrix @ hitch - wanted).max())
    if apart > 1e-6 * max(1.0, float(np.abs(wanted).max())):
        raise ObstacleError(
            f"they have no hitch: no two points of them stay together, the closest get {apart:.3g} apart."
        )
    if hitch[2] < 0.0:
        frames = [frames[0], (*frames[1][:2], math.remainder(frames[1][2] + math.pi, 2.0 * math.pi))]
        hitch[2:] = -hitch[2:]
    aside = np.where(np.abs(hitch[1::2]) > NOTHING, hitch[1::2], 0.0).tolist()
    moved = [
        (x - math.sin(angle) * move, y + math.cos(angle) * move, angle)
        for (x, y, angle), move in zip(frames, aside, strict=True)
    ]
    return moved, float(hitch[0]), float(hitch[2])


def _limit(
    block: Any, phase: Any, equations: InverseKinematics, frames: list[Frame], shape: Polytope, trailer: Trailer
) -> float:
    """Up to which angle, to both sides, bounds and rows of headings hold, and car and trailer keep their clearance."""
    headings = equations.headings
    names, count = equations.read(headings), len(ANGLES)
    now = {name: np.full(count, float(equations.variables[name].value or 0.0)) for name in equations.variables}
    first = equations.evaluated(headings[:1], now, count)[:, 0]
    wanted = np.column_stack([first, first + frames[0][2] + ANGLES - frames[1][2]])
    values = equations.solved(names, now, headings, wanted)
    allowed = np.abs(equations.evaluated(headings, values, count) - wanted).max(axis=1) <= 1e-6
    for statement in phase.record.statements_of("constraint"):
        for row in phase.component(statement.name).values():
            read = equations.read([row.body]) if isinstance(row, ConstraintData) else []
            if read and set(read) <= set(names):
                body = equations.evaluated([row.body], values, count)[:, 0]
                low, high = (default if end is None else end for end, default in ((row.lb, -np.inf), (row.ub, np.inf)))
                allowed &= (body >= low - 1e-6) & (body <= high + 1e-6)
    clearances = block.record.scene.clearances
    clearance = next((clearances[pair] for pair in clearances if set(pair) == {shape.name, trailer.shape.name}), None)
    if clearance is not None:
        places = trailer.poses(np.column_stack([np.zeros((count, 3)), ANGLES]))
        allowed &= [
            signed_distance(trailer.shape, shape, planar_pose(*place)).distance >= clearance for place in places
        ]
    return float(np.abs(ANGLES[~allowed]).min(initial=ANGLES[-1] + ANGLES[1] - ANGLES[0]) - ANGLES[1] + ANGLES[0])


def _of_body(poses: Array, ahead: Array, turns: Array, frame: Frame) -> tuple[Array, Array]:
    """Poses of a body and their rates, ``(n, 3)`` each, where a frame on its axle has these poses and velocities."""
    x, y, angle = frame
    own = np.array([-(math.cos(angle) * x + math.sin(angle) * y), math.sin(angle) * x - math.cos(angle) * y])
    cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    ahead, aside = ahead - turns * own[1], turns * own[0]
    target = np.column_stack([placed(poses, own[None])[:, 0], poses[:, 2] - angle])
    return target, np.column_stack([cosine * ahead - sine * aside, sine * ahead + cosine * aside, turns])


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
    return np.array([*place, float(value(heading_of(pose))) + frame[2]])


def heading_of(pose: Pose) -> Any:
    """The angle of a pose in the plane, which may consist of poses in each other's frames."""
    return sum(map(plain_entry, pose.angles))


class InverseKinematics(InverseDynamics):
    """The poses of bodies, solved for the states that they read, and the equations of these for their controls.

    Parameters
    ----------
    block : ObstacleAvoidanceBlockData
    phase : PhaseBlockData
    bodies : sequence of str

    Attributes
    ----------
    poses : list of Pose
    headings : list of expression
        Their angles.
    pose_states : list of str
        What the poses read of the phase.
    place : list of str or None
        The variables that are x and y of the first pose; None where an expression is.
    """

    def __init__(self, block: Any, phase: Any, bodies: Sequence[str]) -> None:
        super().__init__(phase)
        self.poses: list[Pose] = [
            block.motion.pose_at_node(block.record.scene.bodies[body].pose, self.time, name=body) for body in bodies
        ]
        self.pose_states = self.read([entry for pose in self.poses for entry in pose.entries])
        names = {id(variable): name for name, variable in self.variables.items()}
        self.place = [names.get(id(entry)) for entry in self.poses[0].translation]
        self.headings = [heading_of(pose) for pose in self.poses]
        self._numbers = [entry for pose in self.poses for entry in (*pose.translation, heading_of(pose))]

    def pose_values(self, values: dict[str, Array], count: int) -> Array:
        """x, y and angle of each body, ``(count, 3 bodies)``."""
        return self.evaluated(self._numbers, values, count)

    def pose_jacobian(self, values: dict[str, Array], count: int) -> Array:
        """Derivatives of all x, y and angles by the states that they read, ``(count, 3 bodies, states)``."""
        columns = []
        for name in self.pose_states:
            step = DIFFERENCE * np.maximum(1.0, np.abs(values[name]))
            ahead, behind = values | {name: values[name] + step}, values | {name: values[name] - step}
            columns.append((self.pose_values(ahead, count) - self.pose_values(behind, count)) / (2.0 * step)[:, None])
        return np.stack(columns, axis=2)

    def velocities(self, values: dict[str, Array]) -> Array:
        """Velocities of each body in its own frame, ``(samples, bodies, 3)``: along its two axes, and its turn."""
        rates = self.evaluated([self.rates[name] for name in self.pose_states], values, SAMPLES)
        world = np.einsum("kij,kj->ki", self.pose_jacobian(values, SAMPLES), rates)
        angle = self.pose_values(values, SAMPLES)[:, 2::3]
        cosine, sine, x, y = np.cos(angle), np.sin(angle), world[:, ::3], world[:, 1::3]
        return np.stack([cosine * x + sine * y, cosine * y - sine * x, world[:, 2::3]], axis=-1)

    def states_and_controls(self, target: Array, rates: Array, times: Array) -> dict[str, Array] | None:
        """Values over time with which bodies have the poses and velocities given; None where there are none.

        States of the poses follow from the poses, then what their rates read, then what the rates of these read.
        """
        count = len(times)
        known = {name: np.full(count, float(self.variables[name].value or 0.0)) for name in self.pose_states}
        known = self.solved(self.pose_states, known, self._numbers, target)
        error = self.pose_values(known, count) - target
        if not np.abs(error).max() <= 1e-6 * max(1.0, float(np.abs(target).max())):
            return None
        wanted = (np.linalg.pinv(self.pose_jacobian(known, count)) @ rates[:, :, None])[:, :, 0]
        return self.driven(self.pose_states, known, np.asarray(wanted, dtype=np.float64), times)
