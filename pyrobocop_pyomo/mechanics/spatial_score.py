"""The physical score of a combined plan in space, computed from arrays with laws of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.plotting import AnimationFile, BodyPath, animate_scene

from .physical_score import (
    PUSHING,
    PhysicalScore,
    bound_excess,
    distance_outside,
    excess,
    plan_component,
    smallest_distance,
)
from .planar_bodies import check_positive
from .rotations import inner_product, rotation_matrix, rotation_vector, tangents_across
from .spatial_bodies import POSITION, ROTATION, SPIN, VELOCITY, SpatialBody, SphereRobot
from .spatial_contacts import TANGENTIAL, slip_vector, spatial_wrench_on_body
from .spatial_shapes import SpatialGap

_NEWTON_STEPS = 30

_PLACE, _VELOCITY, _FORCE = ("x", "y", "z"), ("vx", "vy", "vz"), ("tau_x", "tau_y", "tau_z")
_OF_ROBOT = tuple(f"me.{name}" for name in (*_PLACE, *_VELOCITY, *_FORCE, "c", *TANGENTIAL))
_OF_OBJECT = tuple(f"body.{name}" for name in (*POSITION, *ROTATION, *VELOCITY, *SPIN))


@dataclass(frozen=True, eq=False)
class PlannedSphere:
    """One robot of a combined plan in space.

    Attributes
    ----------
    position, velocity : array, shape (T + 1, 3)
        At the element boundaries.
    force : array, shape (T, 3)
        Driving force over each element.
    normal : array, shape (T,)
        Its own contact force along the normal.
    tangential : array, shape (T, 4)
        Along the tangents and against them.
    """

    position: Array
    velocity: Array
    force: Array
    normal: Array
    tangential: Array


@dataclass(frozen=True, eq=False)
class PlannedBody:
    """The object of a combined plan in space.

    Attributes
    ----------
    position : array, shape (T + 1, 3)
    rotation : array, shape (T + 1, 3, 3)
    velocity_at_start, spin_at_start : array, shape (3,)
    """

    position: Array
    rotation: Array
    velocity_at_start: Array
    spin_at_start: Array

    def twist(self, step: float) -> Array:
        """Velocity and angular velocity that lead from pose to pose, shape (T + 1, 6)."""
        velocity = np.diff(self.position, axis=0) / step
        turns = [
            rotation_vector(after @ before.T) for before, after in zip(self.rotation, self.rotation[1:], strict=False)
        ]
        start = np.concatenate([self.velocity_at_start, self.spin_at_start])
        return np.vstack([start, np.hstack([velocity, np.array(turns) / step])])


@dataclass(frozen=True)
class SpatialScore:
    """Scores combined plans of sphere robots that move a body, by physics and never by the status of a solver.

    Nothing of the model is used: residuals are recomputed from positions and rotations, and the object is simulated by
    an implicit step of its own. Only the laws are the same: shapes, gravity, friction.

    Attributes
    ----------
    body : SpatialBody
    robot : SphereRobot
        All robots are alike.
    friction : float
        Between robot and body.
    step : float
        Duration of an element, seconds.
    goal : (x, y, z, r_x, r_y, r_z)
        Where the object has to come to rest, as in `SpatialBody.state_motion`.
    restitution : float
        As in the contact.
    never_normal : (x, y, z)
        As in the contact: it decides where the edges of the friction pyramid are.
    rest_at_end : bool
        Whether the object and the robots have to be at rest at the end, as `state_motion` states by default.
    bounds : mapping of agent to (mapping of component to (lowest, highest))
        Of the variables of the agents that are scored, such as ``{"a": {"me.x": (-1.0, 1.0)}}``; None for no bound.
    """

    body: SpatialBody
    robot: SphereRobot
    friction: float
    step: float
    goal: Sequence[float | tuple[float, float] | None]
    restitution: float = 0.0
    never_normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    rest_at_end: bool = True
    bounds: Mapping[str, Mapping[str, tuple[float | None, float | None]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_positive(self, "friction", "step")

    @property
    def robot_components(self) -> tuple[str, ...]:
        """What is read of a robot's plan."""
        return _OF_ROBOT

    @property
    def hub_components(self) -> tuple[str, ...]:
        """What is read of the object's plan; where the object has no agent of its own, of each robot's copy."""
        return _OF_OBJECT

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
        score = self.of_plan(*self.combined(plans))
        return replace(score, bound_excess=bound_excess(plans, self.bounds))

    def combined(self, plans: Mapping[str, Mapping[str, Array]]) -> tuple[PlannedBody, dict[str, PlannedSphere]]:
        """Reads the combined plan.

        The object's trajectory is that of the agent that is no robot. Where all agents are robots, it is the mean of
        their copies.
        """
        robots = {name: _robot_of(name, plan) for name, plan in plans.items() if "me.x" in plan}
        if not robots:
            raise TrajectoryError(
                f"physical score: none of the plans of {', '.join(map(repr, plans))} has 'me.x', the motion of a robot."
            )
        holders = [name for name in plans if name not in robots] or list(robots)
        bodies = [_body_of(name, plans[name]) for name in holders]
        boundaries = len(bodies[0].position)
        for name, robot in robots.items():
            if len(robot.position) != boundaries or len(robot.normal) != boundaries - 1:
                raise TrajectoryError(
                    f"physical score: the object of '{holders[0]}' has {boundaries} poses, '{name}' has "
                    f"{len(robot.position)} positions and {len(robot.normal)} forces; expected are {boundaries} and "
                    f"{boundaries - 1}."
                )
        if len(bodies) == 1:
            return bodies[0], robots
        each = [
            scipy.spatial.transform.Rotation.from_matrix(r) for r in zip(*(b.rotation for b in bodies), strict=True)
        ]
        return PlannedBody(
            np.mean([body.position for body in bodies], axis=0),
            np.array([copies.mean().as_matrix() for copies in each]),
            np.mean([body.velocity_at_start for body in bodies], axis=0),
            np.mean([body.spin_at_start for body in bodies], axis=0),
        ), robots

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
        shown = self.simulate(body, self._wrenches(body, robots)) if simulated else body
        bodies = [BodyPath(self.body.shape.outline(), shown.rotation, shown.position, "")]
        level = np.tile(np.eye(3), (len(body.position), 1, 1))
        outline = self.robot.shape.outline()
        for name, robot in robots.items():
            at = self._gap(robot, shown.position, shown.rotation)
            force = self._wrench(robot, at)[:, :3]
            # A force lasts over an element; the start shows that of the first.
            force, contact = np.vstack([force[:1], force]), shown.position + np.column_stack(at.point)
            bodies.append(BodyPath(outline, level, robot.position, name, force, contact))
        return np.linspace(0.0, self.step * (len(body.position) - 1), len(body.position)), bodies

    def animate(
        self, plans: Mapping[str, Mapping[str, Array]], path: str | Path | None = None, **options: Any
    ) -> AnimationFile:
        """Write an animation of a combined plan, with the options of `animate_scene`; in a notebook, it plays."""
        time, bodies = self.paths(plans)
        return animate_scene(time, bodies, (), path, **options)

    def of_plan(self, body: PlannedBody, robots: Mapping[str, PlannedSphere]) -> PhysicalScore:
        """Score one combined plan."""
        twist = body.twist(self.step)
        contacts = {name: self._gap(robot, body.position, body.rotation) for name, robot in robots.items()}
        wrench = self._wrenches(body, robots)
        own_forces, products, outside = [], [], [0.0]
        for name, robot in robots.items():
            at = contacts[name]
            own_forces.append(self._missing_force(robot, -self._wrench(robot, at)[:, :3]))
            products.append(self._products(robot, at, twist))
            left = self.friction * robot.normal - robot.tangential.sum(axis=1)
            outside += [float(-side.min()) for side in (robot.normal, robot.tangential, left)]
        missing = self._missing_wrench(twist, body.rotation, wrench)
        simulated = self.simulate(body, wrench)
        later = {name: self._gap(robot, simulated.position, simulated.rotation).gap for name, robot in robots.items()}
        pushed = [later[name][1:][robot.normal > PUSHING] for name, robot in robots.items()]
        gap_product, friction_product, separation_product = np.max(products, axis=0).tolist()
        distance, angle = self._from_goal(simulated)
        forces = np.array([robot.force for robot in robots.values()])
        speeds = np.array([(self._velocity(robot), robot.velocity) for robot in robots.values()])
        end = simulated.twist(self.step)[-1] * self.rest_at_end
        return PhysicalScore(
            object_force=float(np.linalg.norm(missing[:, :3], axis=1).max()),
            object_moment=float(np.linalg.norm(missing[:, 3:], axis=1).max()),
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
            force_excess=excess(forces, *np.transpose(self.robot.force_limits)),
            speed_excess=excess(speeds, -self.robot.speed_limit, self.robot.speed_limit),
            bound_excess=0.0,
            end_speed=float(np.linalg.norm(end[:3])),
            end_spin=float(np.degrees(np.linalg.norm(end[3:]))),
            robot_end_speed=float(np.linalg.norm(speeds[:, 0, -1], axis=1).max() * self.rest_at_end),
        )

    def simulate(self, body: PlannedBody, wrench: Array) -> PlannedBody:
        """The object's motion from the start of a plan under given wrenches, by implicit Euler steps.

        Parameters
        ----------
        body : PlannedBody
            Only its start is read.
        wrench : array, shape (T, 6)
            Force and moment over each step: newtons, newton metres.
        """
        velocity, spin = np.array(body.velocity_at_start), np.array(body.spin_at_start)
        positions, rotations = [body.position[0]], [body.rotation[0]]
        weight = np.array([0.0, 0.0, -self.body.gravity])
        for pushed in wrench:
            velocity = velocity + self.step * (pushed[:3] / self.body.mass + weight)
            spin = self._implicit_spin(spin, pushed[3:], rotations[-1])
            positions.append(positions[-1] + self.step * velocity)
            rotations.append(rotation_matrix(self.step * spin) @ rotations[-1])
        return PlannedBody(np.array(positions), np.array(rotations), body.velocity_at_start, body.spin_at_start)

    def _implicit_spin(self, before: Array, moment: Array, rotation: Array) -> Array:
        """Solves ``w - before = step a(w)`` with Euler's equations at the end of the step, by Newton's method."""

        def residual(w: Array) -> Array:
            after = rotation_matrix(self.step * w) @ rotation
            left: Array = w - before - self.step * np.array(self.body.angular_acceleration(moment, w, after))
            return left

        w: Array = before + self.step * np.array(self.body.angular_acceleration(moment, before, rotation))
        for _ in range(_NEWTON_STEPS):
            value = residual(w)
            if np.abs(value).max() < 1e-13 * (1 + np.abs(w).max()):
                break
            jacobian = np.column_stack([(residual(w + shift) - value) / 1e-7 for shift in 1e-7 * np.eye(3)])
            w = w - np.linalg.solve(jacobian, value)
        return w

    def _missing_wrench(self, twist: Array, rotation: Array, wrench: Array) -> Array:
        """What the object would need beside the robots' wrenches and its weight, shape (T, 6)."""
        rates = np.diff(twist, axis=0) / self.step
        force = self.body.mass * (rates[:, :3] + np.array([0.0, 0.0, self.body.gravity])) - wrench[:, :3]
        inertia = np.einsum("tij,j,tkj->tik", rotation[1:], np.array(self.body.moments), rotation[1:])
        spin = twist[1:, 3:]
        needed = np.einsum("tij,tj->ti", inertia, rates[:, 3:]) + np.cross(spin, np.einsum("tij,tj->ti", inertia, spin))
        return np.hstack([force, needed - wrench[:, 3:]])

    def _gap(self, robot: PlannedSphere, position: Array, rotation: Array) -> SpatialGap:
        turned = np.moveaxis(rotation, 0, -1)
        return self.body.shape.gap_to_sphere(self.robot.shape.radius, robot.position.T, position.T, turned)

    def _wrenches(self, body: PlannedBody, robots: Mapping[str, PlannedSphere]) -> Array:
        """The sum of the robots' own wrenches on the body, shape (T, 6)."""
        gaps = {name: self._gap(robot, body.position, body.rotation) for name, robot in robots.items()}
        total: Array = np.sum([self._wrench(robot, gaps[name]) for name, robot in robots.items()], axis=0)
        return total

    def _wrench(self, robot: PlannedSphere, at: SpatialGap) -> Array:
        """The robot's own wrench on the body over each element, kinematics at its end."""
        ends = SpatialGap(*(entry[1:] for entry in at))
        along = robot.tangential[:, :2] - robot.tangential[:, 2:]
        tangents = tangents_across(ends.normal, self.never_normal)
        return np.column_stack(spatial_wrench_on_body(ends, tangents, robot.normal, along.T))

    def _velocity(self, robot: PlannedSphere) -> Array:
        """Of the robot at the element boundaries, from its positions; shape (T + 1, 3)."""
        return np.vstack([robot.velocity[:1], np.diff(robot.position, axis=0) / self.step])

    def _missing_force(self, robot: PlannedSphere, contact: Array) -> float:
        rates = np.diff(self._velocity(robot), axis=0) / self.step
        needed = self.robot.mass * (rates + np.array([0.0, 0.0, self.robot.gravity]))
        return float(np.linalg.norm(needed - robot.force - contact, axis=1).max())

    def _products(self, robot: PlannedSphere, at: SpatialGap, twist: Array) -> tuple[float, float, float]:
        """Largest gap, friction and separation product of one robot's contact."""
        slip = slip_vector(at, list(self._velocity(robot).T), list(twist.T))
        w_n = inner_product(at.normal, slip)
        w = np.array([inner_product(tangent, slip) for tangent in tangents_across(at.normal, self.never_normal)])[:, 1:]
        along = np.vstack([w, -w]).T
        speed = np.abs(w).max(axis=0)
        c, alphas = robot.normal, robot.tangential
        friction = np.column_stack(
            [alphas * (speed[:, None] + along), speed * (self.friction * c - alphas.sum(axis=1))]
        )
        gap = at.gap[:-1] if self.restitution else at.gap[1:]
        separation = c * (w_n[1:] + self.restitution * w_n[:-1])
        return float(np.abs(c * gap).max()), float(np.abs(friction).max()), float(np.abs(separation).max())

    def _from_goal(self, body: PlannedBody) -> tuple[float, float]:
        position, turn = list(self.goal)[:3], list(self.goal)[3:]
        off = [distance_outside(float(at), wanted) for at, wanted in zip(body.position[-1], position, strict=True)]
        if turn == [None] * 3:
            return float(np.linalg.norm(off)), 0.0
        left = rotation_vector(body.rotation[-1] @ rotation_matrix(turn).T)
        return float(np.linalg.norm(off)), float(np.degrees(np.linalg.norm(left)))


def _robot_of(name: str, plan: Mapping[str, Array]) -> PlannedSphere:
    def columns(*components: str) -> Array:
        return np.column_stack([plan_component(name, plan, f"me.{component}") for component in components])

    return PlannedSphere(
        columns(*_PLACE),
        columns(*_VELOCITY),
        columns(*_FORCE),
        plan_component(name, plan, "me.c"),
        columns(*TANGENTIAL),
    )


def _body_of(name: str, plan: Mapping[str, Array]) -> PlannedBody:
    def columns(components: Sequence[str]) -> Array:
        return np.column_stack([plan_component(name, plan, f"body.{component}") for component in components])

    position, twist = columns(POSITION), columns((*VELOCITY, *SPIN))
    # Copies are kinematic: their velocities live on elements, so that the start of the object is taken as rest.
    start = twist[0] if len(twist) == len(position) else np.zeros(6)
    return PlannedBody(position, columns(ROTATION).reshape(-1, 3, 3), start[:3], start[3:])
