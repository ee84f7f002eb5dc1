"""Cars in a model, recognised by how their body moves; a path that a car can drive then leads the initial guess.

A body in the plane has three velocities in its own frame: ahead, aside, and its turn. Those of a car (bicycle,
unicycle, differential drive) satisfy one linear equation whatever its controls do: the middle of the rear axle does not
move along the axle. The equation is found from velocities at random values of everything that the phase's equations
read, so neither names nor the choice of the reference point matter.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.car_paths import CarPath, staged_search
from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.geometry import Polytope, Pose
from pyrobocop_pyomo.modeling.variable_values import within_bounds
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases import PhaseBlockData, phases_of
from pyrobocop_pyomo.phases.horizon import horizon_fraction

from .body_equations import BodyEquations

logger = logging.getLogger(__name__)

# Relative to the largest velocity: what counts as zero.
NOTHING = 1e-7
# Of the body: the radius of the turns of one that could turn on the spot, and how far beyond start and goal it may go;
# farther where there is no path.
SMALLEST_RADIUS = 0.5
ROOM = (3.0, 8.0)
FINE = 400


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
    _equations: BodyEquations

    def path(self, block: Any, clearances: float, time_limit: float | None) -> CarPath:
        """Path from where the body starts to where it ends, clear of all that rests.

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
        return staged_search(
            tuple(ends[0]),
            tuple(ends[1]),
            body=self.shape,
            obstacles=walls,
            wheelbase=radius,
            steering_limit=0.25 * math.pi,
            regions=[self._region(ends, room) for room in ROOM],
            clearance=clearances * clearance,
            time_limit=time_limit,
        ).path

    def _region(self, ends: Sequence[Array], room: float) -> Any:
        """Around start and goal, within the bounds of variables that are the body's place."""
        points = np.array(ends)[:, :2]
        beyond = room * self.shape.reach + 2.0 * self.turning_radius
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
    equations = BodyEquations(block, phase, body)
    if len(equations.pose_states) != 3 or len(equations.pose.angles) != 1:
        return None
    if not set(equations.pose_states) <= set(equations.rates):
        return None
    found = equations.velocities(equations.sampled(equations.pose_states, np.random.default_rng(0)))
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
