"""Scores of combined plans in the plane and in space, computed from arrays with laws of their own.

What a plan is worth are numbers that no solver reports, and two words for them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.plotting import AnimationFile, BodyPath, animate_scene
from pyrobocop_pyomo.presentation import Presented

from .bodies import DrivenRobot, RigidBody, check_positive
from .contacts import RobotContact
from .rotations import rotation_matrix, rotation_rows, rotation_vector
from .shapes import Gap

# Below this normal force nobody is said to push, newtons.
_PUSHING = 0.1

_LEVELS = ("strict", "practical")


def _measured(label: str, unit: str, whose: str, strict: float, practical: float | None) -> Any:
    """A number of the score: whose trajectory of the object it is about, and the limits of strict and practical.

    What practical asks for, strict asks for as well: a strict plan is practical.
    """
    return field(metadata={"label": label, "unit": unit, "whose": whose, "strict": strict, "practical": practical})


@dataclass(frozen=True)
class PhysicalScore(Presented):
    """How far a combined plan is from physics.

    A combined plan is one trajectory of the object, each robot's own motion, and each robot's own contact forces. The
    object's trajectory *of the plan* is the one that was planned. The *simulated* one starts where that starts and
    moves under the sum of the wrenches that the robots' own forces make; nothing else of the plan is in it.

    Attributes
    ----------
    object_force, object_moment : float
        Largest force and moment that the object would need beside the robots' own wrenches and what resists it, to
        follow the plan: newtons, newton metres.
    robot_force : float
        Largest force that a robot would need beside its driving force and its contact force, newtons.
    cone_excess : float
        Largest force outside the friction cone: negative normal or tangential unknowns included, newtons.
    gap_product : float
        Largest normal force times gap, newton metres.
    friction_product : float
        Largest product of the friction pairs, their slip speed recomputed, newton metres per second.
    separation_product : float
        Largest normal force times separating speed, newton metres per second.
    penetration : float
        Of a robot into the object of the plan, metres.
    goal_distance, goal_angle : float
        Of the simulated object at the end from its goal: metres, degrees.
    gap_at_force : float
        Largest gap to the simulated object where a normal force exceeds 0.1 N, metres.
    simulated_penetration : float
        Of a robot into the simulated object, metres.
    distance : float
        Smallest distance between the centres of two robots, metres; infinite for one robot.
    force_excess : float
        Largest driving force beyond the robots' limits along an axis, newtons.
    speed_excess : float
        Largest speed of a robot beyond its limit along an axis, as planned or as positions have it, metres per second.
    bound_excess : float
        How far a variable of a plan is outside the bounds that the score was given, in its unit.
    end_speed, end_spin : float
        Of the simulated object at the end: metres and degrees per second; 0 where no rest is required.
    robot_end_speed : float
        Of the fastest robot at the end, metres per second; 0 where no rest is required.
    """

    object_force: float = _measured("force missing to the object's path", "N", "plan", 0.05, None)
    object_moment: float = _measured("moment missing to the object's path", "N m", "plan", 0.05, None)
    robot_force: float = _measured("force missing to the robots' paths", "N", "plan", 0.05, None)
    cone_excess: float = _measured("force outside the friction cone", "N", "-", 0.05, 0.05)
    gap_product: float = _measured("force times gap", "N m", "plan", 0.02, 0.02)
    friction_product: float = _measured("friction that does not oppose slip", "N m/s", "plan", 0.02, 0.02)
    separation_product: float = _measured("force times separating speed", "N m/s", "plan", 0.02, 0.02)
    penetration: float = _measured("penetration", "m", "plan", 0.002, None)
    goal_distance: float = _measured("distance from the goal", "m", "simulated", 0.02, 0.05)
    goal_angle: float = _measured("angle from the goal", "deg", "simulated", 2.0, 5.0)
    gap_at_force: float = _measured("gap where a robot pushes", "m", "simulated", 0.01, 0.01)
    simulated_penetration: float = _measured("penetration", "m", "simulated", 0.01, 0.01)
    distance: float = _measured("distance of robots", "m", "-", 0.2, 0.2)
    force_excess: float = _measured("driving force beyond its limit", "N", "-", 0.05, 0.05)
    speed_excess: float = _measured("speed of a robot beyond its limit", "m/s", "-", 0.02, 0.05)
    bound_excess: float = _measured("variable outside its bounds", "-", "plan", 0.002, 0.01)
    end_speed: float = _measured("speed at the end", "m/s", "simulated", 0.02, 0.05)
    end_spin: float = _measured("angular speed at the end", "deg/s", "simulated", 2.0, 5.0)
    robot_end_speed: float = _measured("speed of a robot at the end", "m/s", "-", 0.02, 0.05)

    @property
    def strict(self) -> bool:
        """Whether the plan is practical, residuals are under 0.05 N, penetration under 2 mm; the simulated object ends
        within 2 cm and 2 deg of its goal, at no more than 2 cm and 2 deg per second where rest is required.
        """
        return not self.misses("strict")

    @property
    def practical(self) -> bool:
        """Whether the simulated object ends within 5 cm and 5 deg of its goal, at no more than 5 cm and 5 deg per
        second where rest is required, is pushed where it is touched (gap and penetration under 1 cm), products are
        under 0.02, and robots keep their limits.
        """
        return not self.misses("practical")

    def misses(self, level: str) -> list[str]:
        """The numbers that miss the limits of "strict" or "practical"; each as ``'label: value unit (limit)'``."""
        misses = []
        for entry in fields(self):
            value, limit, row = getattr(self, entry.name), entry.metadata[level], entry.metadata
            # A number that is not a number keeps no limit.
            if limit is not None and not (value > limit if entry.name == "distance" else value < limit):
                misses.append(f"{row['label']} ({row['whose']}): {value:.3g} {row['unit']} (limit {limit:g})")
        return misses

    def __str__(self) -> str:
        word = "strict" if self.strict else "practical" if self.practical else "not physically valid"
        lines = [f"physical score: {word}", f"{'':36}{'object':>10}{'value':>12}       strict  practical"]
        for entry in fields(self):
            row, value = entry.metadata, getattr(self, entry.name)
            limits = (row[level] for level in _LEVELS)
            shown = "".join(f"{'-' if limit is None else format(limit, 'g'):>10} " for limit in limits)
            lines.append(f"{row['label']:36}{row['whose']:>10}{value:>12.3g} {row['unit']:6}{shown}".rstrip())
        return "\n".join(lines)


@dataclass(frozen=True, eq=False)
class PlannedRobot:
    """One robot of a combined plan, in d dimensions.

    Attributes
    ----------
    position, velocity : array, shape (T + 1, d)
        At the element boundaries.
    force : array, shape (T, d)
        Driving force over each element.
    normal : array, shape (T,)
        Its own contact force along the normal.
    tangential : array, shape (T, 2 d - 2)
        Along each tangent, then against each.
    """

    position: Array
    velocity: Array
    force: Array
    normal: Array
    tangential: Array


@dataclass(frozen=True, eq=False)
class PlannedBody:
    """The object of a combined plan, in d dimensions.

    Attributes
    ----------
    position : array, shape (T + 1, d)
        At the element boundaries, metres.
    rotation : array, shape (T + 1, d, d)
    twist_at_start : array, shape (3,) or (6,)
        Velocity and angular velocity.
    """

    position: Array
    rotation: Array
    twist_at_start: Array

    def twist(self, step: float) -> Array:
        """Velocity and angular velocity that lead from pose to pose, shape (T + 1, 3) or (T + 1, 6)."""
        turns = [
            rotation_vector(after @ before.T) for before, after in zip(self.rotation, self.rotation[1:], strict=False)
        ]
        moves = np.hstack([np.diff(self.position, axis=0), turns])
        return np.vstack([self.twist_at_start, moves / step])


@dataclass(frozen=True)
class CombinedPlanScore:
    """Scores combined plans of robots that move a body, by physics and never by the status of a solver.

    Nothing of the model is used: residuals are recomputed from positions, and the object is simulated by an implicit
    step of its own. Only the laws are the same: shapes, resistance, gravity, friction.

    Attributes
    ----------
    body : RigidBody
    robot : DiscRobot or SphereRobot
        All robots are alike.
    friction : float
        Between robot and body.
    step : float
        Duration of an element, seconds.
    goal : sequence
        Where the object has to come to rest, as in `RigidBody.state_motion`; None for a coordinate that may be
        anything. An entry may also be a pair (lower, upper).
    rest_at_end : bool
        Whether the object and the robots have to be at rest at the end, as `state_motion` states by default.
    bounds : mapping of agent to (mapping of component to (lowest, highest))
        Of the variables of the agents that are scored, such as ``{"a": {"me.x": (-1.0, 1.0)}}``; None for no bound.
    never_normal : (x, y, z)
        As in the contact: in space it decides where the edges of the friction pyramid are.

    Notes
    -----
    Accelerations are differences of velocities that are themselves differences of positions, so that a path that is
    displaced at one point is found out.
    """

    body: RigidBody
    robot: DrivenRobot
    friction: float
    step: float
    goal: Sequence[float | tuple[float, float] | None]
    rest_at_end: bool = True
    bounds: Mapping[str, Mapping[str, tuple[float | None, float | None]]] = field(default_factory=dict)
    never_normal: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        check_positive(self, "friction", "step")

    @property
    def robot_components(self) -> tuple[str, ...]:
        """Components that are read of a robot's plan."""
        motion = [f"me.{kind}{axis}" for kind in ("", "v", "tau_") for axis in self.body.shape.names.axes]
        return (*motion, "me.c", *(f"me.{name}" for name in self.body.shape.names.tangential))

    @property
    def hub_components(self) -> tuple[str, ...]:
        """What is read of the object's plan; where the object has no agent of its own, of each robot's copy."""
        names = self.body.shape.names
        return tuple(f"body.{name}" for name in (*names.position, *names.orientation, *names.twist))

    def __call__(self, plans: Mapping[str, Mapping[str, Array]]) -> PhysicalScore:
        """Score the plans of all agents.

        Parameters
        ----------
        plans : mapping of agent to (mapping of component to array)
            Values over time by the component's name in the agent's model, such as ``plans["a"]["me.x"]``: one per
            element boundary for states, one per element for the others.

        Returns
        -------
        PhysicalScore

        Raises
        ------
        TrajectoryError
            When a component is missing, no agent has a robot's motion, lengths do not fit, or bounds are for others.
        """
        score, outside = self._of_plan(*self.combined(plans)), [0.0]
        for agent, limits in self.bounds.items():
            if agent not in plans:
                raise TrajectoryError(f"physical score: bounds for '{agent}'; there are plans of {', '.join(plans)}.")
            outside += [_excess(_component(agent, plans[agent], name), *limit) for name, limit in limits.items()]
        return replace(score, bound_excess=float(np.max(outside)))

    def combined(self, plans: Mapping[str, Mapping[str, Array]]) -> tuple[PlannedBody, dict[str, PlannedRobot]]:
        """Reads the combined plan: the planned body, and the robots by name.

        The object's trajectory comes from the agent that is no robot. Where all agents are robots, it is the mean of
        their copies.
        """
        robots = {name: self._robot_of(name, plan) for name, plan in plans.items() if "me.x" in plan}
        if not robots:
            raise TrajectoryError(
                f"physical score: none of the plans of {', '.join(map(repr, plans))} has 'me.x', the motion of a robot."
            )
        holders = [name for name in plans if name not in robots] or list(robots)
        bodies = [self._body_of(name, plans[name]) for name in holders]
        boundaries = len(bodies[0].position)
        for name, robot in robots.items():
            if len(robot.position) != boundaries or len(robot.normal) != boundaries - 1:
                raise TrajectoryError(
                    f"physical score: the object of '{holders[0]}' has {boundaries} poses, '{name}' has "
                    f"{len(robot.position)} positions and {len(robot.normal)} forces; expected are {boundaries} and "
                    f"{boundaries - 1}."
                )
        return bodies[0] if len(bodies) == 1 else _mean_of(bodies), robots

    def paths(self, plans: Mapping[str, Mapping[str, Array]]) -> tuple[Array, list[BodyPath]]:
        """What `draw_scene` and `animate_scene` show: times, shape (T + 1,), and paths of the object and the robots.

        Parameters
        ----------
        plans : mapping of agent to (mapping of component to array)
            As for the score.

        Raises
        ------
        TrajectoryError
            When a component is missing.
        """
        body, robots = self.combined(plans)
        count, axes = body.position.shape
        level, outline = np.tile(np.eye(axes), (count, 1, 1)), self.robot.shape.outline()
        bodies = [BodyPath(self.body.shape.outline(), body.rotation, body.position, "")]
        bodies += [BodyPath(outline, level, robot.position, name) for name, robot in robots.items()]
        return np.linspace(0.0, self.step * (count - 1), count), bodies

    def animate(
        self, plans: Mapping[str, Mapping[str, Array]], path: str | Path | None = None, **options: Any
    ) -> AnimationFile:
        """Write an animation of a combined plan, with the options of `animate_scene`; in a notebook, it plays."""
        time, bodies = self.paths(plans)
        return animate_scene(time, bodies, (), path, **options)

    def simulate(self, body: PlannedBody, wrench: Array) -> PlannedBody:
        """The object's motion from the start of a plan under given wrenches, by implicit Euler steps.

        Parameters
        ----------
        body : PlannedBody
            Only its start is read.
        wrench : array, shape (T, 3) or (T, 6)
            Force and moment over each step: newtons, newton metres.
        """
        axes, twist = len(self.body.shape.names.axes), body.twist_at_start
        positions, rotations = [body.position[0]], [body.rotation[0]]
        for pushed in wrench:
            twist = self._implicit_step(twist, rotations[-1], pushed)
            positions.append(positions[-1] + self.step * twist[:axes])
            rotations.append(rotation_matrix(self.step * twist[axes:]) @ rotations[-1])
        return PlannedBody(np.array(positions), np.array(rotations), body.twist_at_start)

    def _implicit_step(self, before: Array, rotation: Array, pushed: Array) -> Array:
        """The velocities at the end of a step at which nothing but the wrench is needed."""
        scale = self.step / self._inertia

        def residual(twist: Array) -> Array:
            after = rotation_matrix(self.step * twist[len(rotation) :]) @ rotation
            needed: Array = self._needed_wrench(after[None], twist[None], (twist - before)[None] / self.step)[0]
            return scale * (needed - pushed)

        def jacobian(twist: Array) -> Array:
            # MINPACK's own differences take steps relative to each velocity, and see nothing where one is tiny.
            slopes: Array = scipy.optimize.approx_fprime(twist, residual, 1e-7)
            return slopes

        # Velocities that solve it to rounding: their differences are accelerations.
        velocities: Array = scipy.optimize.root(residual, before + scale * pushed, jac=jacobian, tol=1e-13).x
        return velocities

    def _of_plan(self, body: PlannedBody, robots: Mapping[str, PlannedRobot]) -> PhysicalScore:
        """Score one combined plan."""
        axes, every, twist = len(self.body.shape.names.axes), _stacked(robots), body.twist(self.step)
        moves = np.diff(every.position, axis=1) / self.step
        velocity = np.concatenate([every.velocity[:, :1], moves], axis=1)
        at = self._gap(every, body)
        wrench = self._wrench(every, at)
        accelerations = np.diff(velocity, axis=1) / self.step - self.robot.falling
        own = self.robot.mass * accelerations - every.force + wrench[..., :axes]
        missing = self._needed_wrench(body.rotation[1:], twist[1:], np.diff(twist, axis=0) / self.step)
        missing = missing - wrench.sum(axis=0)
        simulated = self.simulate(body, wrench.sum(axis=0))
        later = self._gap(every, simulated).gap
        distance, angle = self._from_goal(simulated)

        normal, tangential = every.normal, every.tangential
        left = self.friction * normal - tangential.sum(axis=2)
        w_n, *w = np.array(self.contact.velocity(at, np.moveaxis(velocity, 2, 0), twist.T))[..., 1:]
        along = np.stack([*w, *(-each for each in w)], axis=2)
        slip = np.abs(along).max(axis=2)
        friction = [tangential * (slip[..., None] + along), slip * left]
        speeds, pairs = np.array([velocity, every.velocity]), combinations(every.position, 2)
        end = simulated.twist(self.step)[-1] * self.rest_at_end
        return PhysicalScore(
            object_force=float(np.linalg.norm(missing[:, :axes], axis=1).max()),
            object_moment=float(np.linalg.norm(missing[:, axes:], axis=1).max()),
            robot_force=float(np.linalg.norm(own, axis=2).max()),
            cone_excess=float(np.max([0.0, *(-side.min() for side in (normal, tangential, left))])),
            gap_product=float(np.abs(normal * at.gap[:, 1:]).max()),
            friction_product=float(np.max([np.abs(product).max() for product in friction])),
            separation_product=float(np.abs(normal * w_n).max()),
            penetration=_excess(at.gap, 0.0, None),
            goal_distance=distance,
            goal_angle=angle,
            gap_at_force=float(np.max([0.0, *later[:, 1:][normal > _PUSHING]])),
            simulated_penetration=_excess(later, 0.0, None),
            distance=float(np.min([np.inf, *(np.linalg.norm(a - b, axis=1).min() for a, b in pairs)])),
            force_excess=_excess(every.force, *self.robot.driving_limits),
            speed_excess=_excess(speeds, -self.robot.speed_limit, self.robot.speed_limit),
            bound_excess=0.0,
            end_speed=float(np.linalg.norm(end[:axes])),
            end_spin=float(np.degrees(np.linalg.norm(end[axes:]))),
            robot_end_speed=float(np.linalg.norm(velocity[:, -1], axis=1).max() * self.rest_at_end),
        )

    def _robot_of(self, name: str, plan: Mapping[str, Array]) -> PlannedRobot:
        axes = self.body.shape.names.axes
        position, velocity, force, tangential = (
            _columns(name, plan, [f"me.{each}" for each in names])
            for names in (axes, [f"v{a}" for a in axes], [f"tau_{a}" for a in axes], self.body.shape.names.tangential)
        )
        return PlannedRobot(position, velocity, force, _component(name, plan, "me.c"), tangential)

    def _body_of(self, name: str, plan: Mapping[str, Array]) -> PlannedBody:
        own = self.body.shape.names
        position, orientation, twist = (
            _columns(name, plan, [f"body.{each}" for each in names])
            for names in (own.position, own.orientation, own.twist)
        )
        # Copies are kinematic: their velocities live on elements, so that the start of the object is taken as rest.
        start = twist[0] if len(twist) == len(position) else np.zeros(twist.shape[1])
        return PlannedBody(position, np.moveaxis(np.array(rotation_rows(orientation.T)), -1, 0), start)

    def _gap(self, robot: PlannedRobot, body: PlannedBody) -> Gap:
        return self.contact.gap(np.moveaxis(robot.position, -1, 0), body.position.T, np.moveaxis(body.rotation, 0, -1))

    def _wrench(self, robot: PlannedRobot, at: Gap) -> Array:
        """The robot's own wrench on the body over each element, shape (..., T, 3) or (..., T, 6); kinematics at its
        end.
        """
        ends = Gap(at.gap[..., 1:], np.array(at.normal)[..., 1:], np.array(at.point)[..., 1:])
        along, against = np.split(np.moveaxis(robot.tangential, -1, 0), 2)
        return np.stack(self.contact.wrench_on_body(ends, robot.normal, along - against), axis=-1)

    def _from_goal(self, body: PlannedBody) -> tuple[float, float]:
        """Distance and angle of the object at the end from its goal: metres, degrees."""
        axes = len(self.body.shape.names.axes)
        position, turn = list(self.goal)[:axes], [angle for angle in self.goal[axes:] if angle is not None]
        ends = [wanted if isinstance(wanted, tuple) else (wanted, wanted) for wanted in position]
        off = [_excess(at, *limits) for at, limits in zip(body.position[-1], ends, strict=True)]
        if not turn:
            return float(np.linalg.norm(off)), 0.0
        # In the plane the angle may be between two; a whole turn more or less is the same pose.
        wanted = rotation_matrix([float(np.mean(angle)) for angle in turn])
        angle = float(np.linalg.norm(rotation_vector(body.rotation[-1] @ wanted.T)))
        return float(np.linalg.norm(off)), float(np.degrees(max(angle - np.ptp(turn[0]) / 2, 0.0)))

    @property
    def contact(self) -> RobotContact:
        """Of a robot with the object."""
        return RobotContact(self.body.shape, self.robot.shape, self.friction, never_normal=self.never_normal)

    @property
    def _inertia(self) -> Array:
        """Of the object along each velocity, in the directions of its frame."""
        return np.array([*len(self.body.shape.names.axes) * [self.body.mass], *self.body.moments])

    def _needed_wrench(self, rotation: Array, twist: Array, rates: Array) -> Array:
        """Wrenches, shape (n, 3) or (n, 6), that the object needs beside what acts on it anyway.

        Parameters
        ----------
        rotation : array, shape (n, d, d)
        twist, rates : array, shape (n, 3) or (n, 6)
            Velocities and their rates of change.
        """
        axes = rotation.shape[1]
        # In the plane the one axis that a body turns about stays where it is.
        frame = rotation if axes == 3 else np.ones((len(rotation), 1, 1))
        inertia = np.einsum("tij,j,tkj->tik", frame, self.body.moments, frame)
        momentum, moment = (np.einsum("tij,tj->ti", inertia, each[:, axes:]) for each in (twist, rates))
        if axes == 3:
            moment = moment + np.cross(twist[:, axes:], momentum)
        needed: Array = np.hstack([self.body.mass * rates[:, :axes], moment])
        return needed - np.array(self.body.passive_wrench(twist.T)).T


def _component(agent: str, plan: Mapping[str, Array], name: str) -> Array:
    """Values over time of one component in the plan of an agent.

    Raises
    ------
    TrajectoryError
        When the plan has no such component.
    """
    if name not in plan:
        raise TrajectoryError(
            f"physical score: the plan of '{agent}' has no '{name}'; it has {', '.join(sorted(plan)) or 'nothing'}."
        )
    return np.asarray(plan[name], dtype=float)


def _excess(values: Array, lower: float | Array | None, upper: float | Array | None) -> float:
    """Largest distance of values from an interval, 0 within it; not a number where a value is none."""
    below = 0.0 if lower is None else lower - values
    above = 0.0 if upper is None else values - upper
    return float(np.max(np.maximum(np.maximum(below, above), 0.0 * values)))


def _columns(agent: str, plan: Mapping[str, Array], names: Sequence[str]) -> Array:
    return np.column_stack([_component(agent, plan, name) for name in names])


def _stacked(robots: Mapping[str, PlannedRobot]) -> PlannedRobot:
    """All robots in one: the first axis of each array is over them."""
    return PlannedRobot(*(np.array([getattr(r, e.name) for r in robots.values()]) for e in fields(PlannedRobot)))


def _mean_of(bodies: Sequence[PlannedBody]) -> PlannedBody:
    """Of copies of one planned body: the rotations that are nearest to all of theirs."""
    position, rotation, start = (
        np.mean([getattr(body, name) for body in bodies], axis=0) for name in ("position", "rotation", "twist_at_start")
    )
    left, _, right = np.linalg.svd(rotation)
    return PlannedBody(position, left @ right, start)
