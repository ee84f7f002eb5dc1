"""Scores of combined plans in the plane and in space, computed from arrays with laws of their own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.plotting import AnimationFile, BodyPath, animate_scene

from .bodies import PLANE, SPACE, DiscRobot, Names, PlanarBody, SpatialBody, SphereRobot, check_positive
from .contacts import PlanarContact, RobotContact, SpatialContact
from .physical_score import (
    PUSHING,
    PhysicalScore,
    bound_excess,
    distance_outside,
    excess,
    plan_component,
    smallest_distance,
)
from .rotations import rotation_matrix, rotation_rows, rotation_vector
from .shapes import Gap

_NEWTON_STEPS = 60


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
class CombinedPlanScore(ABC):
    """Scores combined plans of robots that move a body, by physics and never by the status of a solver.

    Nothing of the model is used: residuals are recomputed from positions, and the object is simulated by an implicit
    step of its own. Only the laws are the same: shapes, resistance, gravity, friction.

    Attributes
    ----------
    body, robot : object
        All robots are alike.
    friction : float
        Between robot and body.
    step : float
        Duration of an element, seconds.
    goal : sequence
        Where the object has to come to rest; None for a coordinate that may be anything. An entry may also be a pair
        (lower, upper).
    rest_at_end : bool
        Whether the object and the robots have to be at rest at the end, as `state_motion` states by default.
    bounds : mapping of agent to (mapping of component to (lowest, highest))
        Of the variables of the agents that are scored, such as ``{"a": {"me.x": (-1.0, 1.0)}}``; None for no bound.

    Notes
    -----
    Accelerations are differences of velocities that are themselves differences of positions, so that a path that is
    displaced at one point is found out.
    """

    body: Any
    robot: Any
    friction: float
    step: float
    goal: Sequence[float | tuple[float, float] | None]
    rest_at_end: bool = True
    bounds: Mapping[str, Mapping[str, tuple[float | None, float | None]]] = field(default_factory=dict)

    names: ClassVar[Names]

    def __post_init__(self) -> None:
        check_positive(self, "friction", "step")

    @property
    def robot_components(self) -> tuple[str, ...]:
        """What is read of a robot's plan."""
        motion = [f"me.{kind}{axis}" for kind in ("", "v", "tau_") for axis in self.names.axes]
        return (*motion, "me.c", *(f"me.{name}" for name in self.names.tangential))

    @property
    def hub_components(self) -> tuple[str, ...]:
        """What is read of the object's plan; where the object has no agent of its own, of each robot's copy."""
        names = self.names
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
            When a component is missing, no agent has a robot's motion, or lengths do not fit.
        """
        score = self._of_plan(*self.combined(plans))
        return replace(score, bound_excess=bound_excess(plans, self.bounds))

    def combined(self, plans: Mapping[str, Mapping[str, Array]]) -> tuple[PlannedBody, dict[str, PlannedRobot]]:
        """Reads the combined plan: the planned body, and the robots by name.

        The object's trajectory is that of the agent that is no robot. Where all agents are robots, it is the mean of
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

    def paths(
        self, plans: Mapping[str, Mapping[str, Array]], *, simulated: bool = False
    ) -> tuple[Array, list[BodyPath]]:
        """What `draw_scene` and `animate_scene` show: times, shape (T + 1,), and paths of the object and the robots.

        Parameters
        ----------
        plans : mapping of agent to (mapping of component to array)
            As for the score.
        simulated : bool
            The simulated object in place of the planned one.

        Raises
        ------
        TrajectoryError
            When a component is missing.
        """
        body, robots = self.combined(plans)
        if simulated:
            body = self.simulate(body, self._sum_of_wrenches(body, robots))
        position = body.position
        bodies = [BodyPath(self.body.shape.outline(), body.rotation, position, "")]
        level = np.tile(np.eye(position.shape[1]), (len(position), 1, 1))
        outline = self.robot.shape.outline()
        for name, robot in robots.items():
            at = self._gap(robot, body)
            force = self._wrench(robot, at)[:, : position.shape[1]]
            # A force lasts over an element; the start shows that of the first.
            force, contact = np.vstack([force[:1], force]), position + np.transpose(at.point)
            bodies.append(BodyPath(outline, level, robot.position, name, force, contact))
        return np.linspace(0.0, self.step * (len(position) - 1), len(position)), bodies

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
        axes, twist = len(self.names.axes), body.twist_at_start
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

        return solve_by_newton(residual, before + scale * pushed)

    def _of_plan(self, body: PlannedBody, robots: Mapping[str, PlannedRobot]) -> PhysicalScore:
        """Score one combined plan."""
        axes = len(self.names.axes)
        twist = body.twist(self.step)
        contacts = {name: self._gap(robot, body) for name, robot in robots.items()}
        wrench = self._sum_of_wrenches(body, robots)
        own_forces, products, outside = [], [], [0.0]
        for name, robot in robots.items():
            at = contacts[name]
            own_forces.append(self._missing_force(robot, -self._wrench(robot, at)[:, :axes]))
            products.append(self._products(robot, at, twist))
            left = self.friction * robot.normal - robot.tangential.sum(axis=1)
            outside += [float(-side.min()) for side in (robot.normal, robot.tangential, left)]
        missing = self._needed_wrench(body.rotation[1:], twist[1:], np.diff(twist, axis=0) / self.step) - wrench
        simulated = self.simulate(body, wrench)
        later = {name: self._gap(robot, simulated).gap for name, robot in robots.items()}
        pushed = [later[name][1:][robot.normal > PUSHING] for name, robot in robots.items()]
        distance, angle = self._from_goal(simulated)
        gap_product, friction_product, separation_product = np.max(products, axis=0).tolist()
        forces = np.array([robot.force for robot in robots.values()])
        speeds = np.array([(self._velocity(robot), robot.velocity) for robot in robots.values()])
        end = simulated.twist(self.step)[-1] * self.rest_at_end
        return PhysicalScore(
            object_force=float(np.linalg.norm(missing[:, :axes], axis=1).max()),
            object_moment=float(np.linalg.norm(missing[:, axes:], axis=1).max()),
            robot_force=float(np.max(own_forces)),
            cone_excess=float(np.max(outside)),
            gap_product=gap_product,
            friction_product=friction_product,
            separation_product=separation_product,
            penetration=excess(np.array([at.gap for at in contacts.values()]), 0.0, None),
            goal_distance=distance,
            goal_angle=angle,
            gap_at_force=float(np.concatenate([np.zeros(1), *pushed]).max()),
            simulated_penetration=excess(np.array(list(later.values())), 0.0, None),
            distance=smallest_distance([robot.position for robot in robots.values()]),
            force_excess=excess(forces, *self.robot.driving_limits),
            speed_excess=excess(speeds, -self.robot.speed_limit, self.robot.speed_limit),
            bound_excess=0.0,
            end_speed=float(np.linalg.norm(end[:axes])),
            end_spin=float(np.degrees(np.linalg.norm(end[axes:]))),
            robot_end_speed=float(np.linalg.norm(speeds[:, 0, -1], axis=1).max() * self.rest_at_end),
        )

    def _robot_of(self, name: str, plan: Mapping[str, Array]) -> PlannedRobot:
        axes = self.names.axes
        position, velocity, force, tangential = (
            _columns(name, plan, [f"me.{each}" for each in names])
            for names in (axes, [f"v{a}" for a in axes], [f"tau_{a}" for a in axes], self.names.tangential)
        )
        return PlannedRobot(position, velocity, force, plan_component(name, plan, "me.c"), tangential)

    def _body_of(self, name: str, plan: Mapping[str, Array]) -> PlannedBody:
        position, orientation, twist = (
            _columns(name, plan, [f"body.{each}" for each in names])
            for names in (self.names.position, self.names.orientation, self.names.twist)
        )
        # Copies are kinematic: their velocities live on elements, so that the start of the object is taken as rest.
        start = twist[0] if len(twist) == len(position) else np.zeros(twist.shape[1])
        return PlannedBody(position, np.moveaxis(np.array(rotation_rows(orientation.T)), -1, 0), start)

    def _gap(self, robot: PlannedRobot, body: PlannedBody) -> Gap:
        return self.contact.gap(robot.position.T, body.position.T, np.moveaxis(body.rotation, 0, -1))

    def _wrench(self, robot: PlannedRobot, at: Gap) -> Array:
        """The robot's own wrench on the body over each element, shape (T, 3) or (T, 6), kinematics at its end."""
        ends = Gap(at.gap[1:], np.array(at.normal)[:, 1:], np.array(at.point)[:, 1:])
        along, against = np.split(robot.tangential.T, 2)
        return np.column_stack(self.contact.wrench_on_body(ends, robot.normal, along - against))

    def _sum_of_wrenches(self, body: PlannedBody, robots: Mapping[str, PlannedRobot]) -> Array:
        """Of the robots' own forces on the body, shape (T, 3) or (T, 6)."""
        total: Array = np.sum([self._wrench(robot, self._gap(robot, body)) for robot in robots.values()], axis=0)
        return total

    def _velocity(self, robot: PlannedRobot) -> Array:
        """Of the robot at the element boundaries, from its positions; shape (T + 1, d)."""
        return np.vstack([robot.velocity[:1], np.diff(robot.position, axis=0) / self.step])

    def _missing_force(self, robot: PlannedRobot, contact: Array) -> float:
        needed = self.robot.mass * (np.diff(self._velocity(robot), axis=0) / self.step - self.robot.falling)
        return float(np.linalg.norm(needed - robot.force - contact, axis=1).max())

    def _products(self, robot: PlannedRobot, at: Gap, twist: Array) -> tuple[float, ...]:
        """Largest gap, friction and separation product of one robot's contact."""
        w_n, *w = np.array(self.contact.velocity(at, self._velocity(robot).T, twist.T))[:, 1:]
        along = np.column_stack([*w, *(-each for each in w)])
        speed = np.abs(along).max(axis=1, keepdims=True)
        c, alphas = robot.normal, robot.tangential
        left = self.friction * c - alphas.sum(axis=1)
        friction = np.column_stack([alphas * (speed + along), speed * left[:, None]])
        return tuple(float(np.abs(product).max()) for product in (c * at.gap[1:], friction, c * w_n))

    def _from_goal(self, body: PlannedBody) -> tuple[float, float]:
        """Distance and angle of the object at the end from its goal: metres, degrees."""
        axes = len(self.names.axes)
        position, turn = list(self.goal)[:axes], [angle for angle in self.goal[axes:] if angle is not None]
        off = [distance_outside(float(at), wanted) for at, wanted in zip(body.position[-1], position, strict=True)]
        if not turn:
            return float(np.linalg.norm(off)), 0.0
        # In the plane the angle may be between two; a whole turn more or less is the same pose.
        wanted = rotation_matrix([float(np.mean(angle)) for angle in turn])
        angle = float(np.linalg.norm(rotation_vector(body.rotation[-1] @ wanted.T)))
        return float(np.linalg.norm(off)), float(np.degrees(max(angle - np.ptp(turn[0]) / 2, 0.0)))

    @property
    @abstractmethod
    def contact(self) -> RobotContact:
        """Of a robot with the object."""

    @property
    @abstractmethod
    def _inertia(self) -> Array:
        """Of the object along each velocity, in the directions of its frame."""

    @abstractmethod
    def _needed_wrench(self, rotation: Array, twist: Array, rates: Array) -> Array:
        """Wrenches, shape (n, 3) or (n, 6), that the object needs beside what acts on it anyway.

        Parameters
        ----------
        rotation : array, shape (n, d, d)
        twist, rates : array, shape (n, 3) or (n, 6)
            Velocities and their rates of change.
        """


@dataclass(frozen=True)
class PlanarScore(CombinedPlanScore):
    """Scores combined plans of disc robots that push a body in the plane; see `CombinedPlanScore`.

    Attributes
    ----------
    body : PlanarBody
    robot : DiscRobot
    goal : (x, y, theta)
    """

    body: PlanarBody
    robot: DiscRobot

    names = PLANE

    @property
    def contact(self) -> PlanarContact:
        """Of a robot with the object."""
        return PlanarContact(self.body.shape, self.robot.shape, self.friction)

    @property
    def _inertia(self) -> Array:
        return np.array([self.body.mass, self.body.mass, self.body.inertia])

    def _needed_wrench(self, rotation: Array, twist: Array, rates: Array) -> Array:
        needed: Array = self._inertia * rates
        if self.body.resistance is not None:
            needed -= np.array(self.body.resistance.wrench(self.body.mass, *twist.T)).T
        return needed


@dataclass(frozen=True)
class SpatialScore(CombinedPlanScore):
    """Scores combined plans of sphere robots that move a body in space; see `CombinedPlanScore`.

    Attributes
    ----------
    body : SpatialBody
    robot : SphereRobot
    goal : (x, y, z, r_x, r_y, r_z)
        Where the object has to come to rest, as in `SpatialBody.state_motion`.
    never_normal : (x, y, z)
        As in the contact: it decides where the edges of the friction pyramid are.
    """

    body: SpatialBody
    robot: SphereRobot
    never_normal: tuple[float, float, float] = (0.0, 0.0, 1.0)

    names = SPACE

    @property
    def contact(self) -> SpatialContact:
        """Of a robot with the object."""
        return SpatialContact(self.body.shape, self.robot.shape, self.friction, never_normal=self.never_normal)

    @property
    def _inertia(self) -> Array:
        return np.array([*3 * [self.body.mass], *self.body.moments])

    def _needed_wrench(self, rotation: Array, twist: Array, rates: Array) -> Array:
        force = self.body.mass * (rates[:, :3] + np.array([0.0, 0.0, self.body.gravity]))
        inertia = np.einsum("tij,j,tkj->tik", rotation, np.array(self.body.moments), rotation)
        spin = twist[:, 3:]
        gyroscopic = np.cross(spin, np.einsum("tij,tj->ti", inertia, spin))
        return np.hstack([force, np.einsum("tij,tj->ti", inertia, rates[:, 3:]) + gyroscopic])


def _columns(agent: str, plan: Mapping[str, Array], names: Sequence[str]) -> Array:
    return np.column_stack([plan_component(agent, plan, name) for name in names])


def _mean_of(bodies: Sequence[PlannedBody]) -> PlannedBody:
    """Of copies of one planned body: the rotations that are nearest to all of theirs."""
    position, rotation, start = (
        np.mean([getattr(body, name) for body in bodies], axis=0) for name in ("position", "rotation", "twist_at_start")
    )
    left, _, right = np.linalg.svd(rotation)
    return PlannedBody(position, left @ right, start)


def solve_by_newton(residual: Callable[[Array], Array], start: Array) -> Array:
    """Velocities at which as many residuals are zero, by a damped Newton iteration with differences."""
    u = start
    for _ in range(_NEWTON_STEPS):
        value = residual(u)
        size = np.abs(value).max()
        if size < 1e-13 * (1 + np.abs(u).max()):
            break
        slopes = np.column_stack([(residual(u + shift) - value) / 1e-7 for shift in 1e-7 * np.eye(len(u))])
        change = np.linalg.solve(slopes, -value)
        # Resistance saturates, so that a full step may overshoot; a residual that grows is not accepted.
        share = 1.0
        while share > 1e-3 and np.abs(residual(u + share * change)).max() >= size:
            share /= 2
        u = u + share * change
    return u
