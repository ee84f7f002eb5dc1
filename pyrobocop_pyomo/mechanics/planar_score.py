"""The physical score of a combined plan in the plane, computed from arrays with laws of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.numerics import Array
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
from .planar_bodies import POSE, TWIST, DiscRobot, PlanarBody, check_positive
from .planar_contacts import contact_wrench_on_body, slip_velocity
from .planar_replay import ContactStep, DrivenReplay
from .planar_shapes import PlanarGap

_NEWTON_STEPS = 60

_UNKNOWNS = ("c", "alpha_plus", "alpha_minus")
_OF_ROBOT = tuple(f"me.{name}" for name in ("x", "y", "vx", "vy", "tau_x", "tau_y", *_UNKNOWNS))
_OF_OBJECT = tuple(f"body.{name}" for name in (*POSE, *TWIST))


@dataclass(frozen=True, eq=False)
class PlannedDisc:
    """One robot of a combined plan.

    Attributes
    ----------
    position, velocity : array, shape (T + 1, 2)
        At the element boundaries.
    force : array, shape (T, 2)
        Driving force over each element.
    normal, along, against : array, shape (T,)
        Its own contact force: along the normal, along the tangent and against it.
    """

    position: Array
    velocity: Array
    force: Array
    normal: Array
    along: Array
    against: Array


@dataclass(frozen=True)
class PlanarScore:
    """Scores combined plans of disc robots that push a body, by physics and never by the status of a solver.

    Nothing of the model is used: residuals are recomputed from positions, and the object is simulated by an implicit
    step of its own. Only the laws are the same: shapes, resistance, friction.

    Attributes
    ----------
    body : PlanarBody
    robot : DiscRobot
        All robots are alike.
    friction : float
        Between robot and body.
    step : float
        Duration of an element, seconds.
    goal : (x, y, theta)
        Where the object has to come to rest; None for a coordinate that may be anything. An entry may also be a pair
        (lower, upper).
    restitution : float
        As in the contact.
    rest_at_end : bool
        Whether the object and the robots have to be at rest at the end, as `state_motion` states by default.
    bounds : mapping of agent to (mapping of component to (lowest, highest))
        Of the variables of the agents that are scored, such as ``{"a": {"me.x": (-1.0, 1.0)}}``; None for no bound.

    Notes
    -----
    Accelerations are differences of velocities that are themselves differences of positions, so that a path that is
    displaced at one point is found out.
    """

    body: PlanarBody
    robot: DiscRobot
    friction: float
    step: float
    goal: Sequence[float | tuple[float, float] | None]
    restitution: float = 0.0
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

    def combined(self, plans: Mapping[str, Mapping[str, Array]]) -> tuple[Array, Array, dict[str, PlannedDisc]]:
        """Reads the combined plan: the object's pose, shape (T + 1, 3), its velocity at the start, shape (3,), robots.

        The object's trajectory is that of the agent that is no robot. Where all agents are robots, it is the mean of
        their copies.
        """
        robots = {name: self._robot_of(name, plan) for name, plan in plans.items() if "me.x" in plan}
        if not robots:
            raise TrajectoryError(
                f"physical score: none of the plans of {', '.join(map(repr, plans))} has 'me.x', the motion of a robot."
            )
        holders = [name for name in plans if name not in robots] or list(robots)
        poses = [np.column_stack([plan_component(name, plans[name], f"body.{q}") for q in POSE]) for name in holders]
        starts = [np.array([plan_component(name, plans[name], f"body.{u}")[0] for u in TWIST]) for name in holders]
        boundaries = len(poses[0])
        for name, robot in robots.items():
            if len(robot.position) != boundaries or len(robot.normal) != boundaries - 1:
                raise TrajectoryError(
                    f"physical score: the object of '{holders[0]}' has {boundaries} poses, '{name}' has "
                    f"{len(robot.position)} positions and {len(robot.normal)} forces; expected are {boundaries} and "
                    f"{boundaries - 1}."
                )
        # Copies are kinematic: their velocities live on elements, so that the start of the object is taken as rest.
        known = len(plan_component(holders[0], plans[holders[0]], f"body.{TWIST[0]}")) == boundaries
        start = np.mean(starts, axis=0) if known else np.zeros(3)
        return np.mean(poses, axis=0), start, robots

    @staticmethod
    def _robot_of(name: str, plan: Mapping[str, Array]) -> PlannedDisc:
        def columns(*components: str) -> Array:
            return np.column_stack([plan_component(name, plan, f"me.{component}") for component in components])

        unknowns = [plan_component(name, plan, f"me.{unknown}") for unknown in _UNKNOWNS]
        return PlannedDisc(columns("x", "y"), columns("vx", "vy"), columns("tau_x", "tau_y"), *unknowns)

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
        pose, start, robots = self.combined(plans)
        if simulated:
            pose = self.simulate(pose[0], start, self._wrench(pose, robots))
        x, y, theta = pose.T
        bodies = [BodyPath.planar(self.body.shape.outline(), x, y, theta, name="")]
        disc = self.robot.shape.outline()
        for name, robot in robots.items():
            level = np.tile(np.eye(2), (len(pose), 1, 1))
            at, force = self._gap(robot, pose), self._wrench(pose, {name: robot})[:, :2]
            contact = pose[:, :2] + np.column_stack([at.point_x, at.point_y])
            # A force lasts over an element; the start shows that of the first.
            force = np.vstack([force[:1], force])
            bodies.append(BodyPath(disc, level, robot.position, name, force, contact))
        return np.linspace(0.0, self.step * (len(pose) - 1), len(pose)), bodies

    def animate(
        self, plans: Mapping[str, Mapping[str, Array]], path: str | Path | None = None, **options: Any
    ) -> AnimationFile:
        """Write an animation of a combined plan, with the options of `animate_scene`; in a notebook, it plays."""
        time, bodies = self.paths(plans)
        return animate_scene(time, bodies, (), path, **options)

    def of_plan(self, pose: Array, velocity_at_start: Array, robots: Mapping[str, PlannedDisc]) -> PhysicalScore:
        """Score one combined plan.

        Parameters
        ----------
        pose : array, shape (T + 1, 3)
            Of the object at the element boundaries: metres, radians.
        velocity_at_start : array, shape (3,)
        robots : mapping of name to PlannedDisc
        """
        twist = np.vstack([velocity_at_start, np.diff(pose, axis=0) / self.step])
        contacts = {name: self._gap(robot, pose) for name, robot in robots.items()}
        wrench = self._wrench(pose, robots)
        own_forces, products, outside = [], [], [0.0]
        for name, robot in robots.items():
            own_forces.append(self._missing_force(robot, -self._wrench(pose, {name: robot})[:, :2]))
            products.append(self._products(robot, contacts[name], twist))
            left = self.friction * robot.normal - robot.along - robot.against
            outside += [float(-side.min()) for side in (robot.normal, robot.along, robot.against, left)]
        missing = self._inertia * np.diff(twist, axis=0) / self.step - wrench - self._resistance(twist[1:])
        simulated = self.simulate(pose[0], velocity_at_start, wrench)
        later = {name: self._gap(robot, simulated).gap for name, robot in robots.items()}
        pushed = [later[name][1:][robot.normal > PUSHING] for name, robot in robots.items()]
        distance, angle = self._from_goal(simulated[-1])
        gap_product, friction_product, separation_product = np.max(products, axis=0).tolist()
        forces = np.array([robot.force for robot in robots.values()])
        speeds = np.array([(self._velocity(robot), robot.velocity) for robot in robots.values()])
        end = np.abs(simulated[-1] - simulated[-2]) / self.step * self.rest_at_end
        return PhysicalScore(
            object_force=float(np.hypot(missing[:, 0], missing[:, 1]).max()),
            object_moment=float(np.abs(missing[:, 2]).max()),
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
            force_excess=excess(forces, -self.robot.force_limit, self.robot.force_limit),
            speed_excess=excess(speeds, -self.robot.speed_limit, self.robot.speed_limit),
            bound_excess=0.0,
            end_speed=float(np.hypot(end[0], end[1])),
            end_spin=float(np.degrees(end[2])),
            robot_end_speed=float(np.linalg.norm(speeds[:, 0, -1], axis=1).max() * self.rest_at_end),
        )

    @property
    def contact_step(self) -> ContactStep:
        """What happens in one step under driving forces: a simulation of contact, for replays and closed loops."""
        return ContactStep(self.body, self.robot, self.friction, self.step, self._resistance)

    def replay(self, plans: Mapping[str, Mapping[str, Array]]) -> DrivenReplay:
        """Play a combined plan back open loop: robots and object start as planned, and move under the robots' driving
        forces and the contact that these lead to. Forces of contact and the planned paths are not read.

        Parameters
        ----------
        plans : mapping of agent to (mapping of component to array)
            As for the score.

        Raises
        ------
        TrajectoryError
            When a component is missing, or contact has restitution.
        """
        if self.restitution:
            raise TrajectoryError(f"replay: restitution = {self.restitution:g}; only contact without it is simulated.")
        pose, twist, robots = self.combined(plans)
        places, speeds, forces = (
            np.array([getattr(robot, name) for robot in robots.values()]) for name in ("position", "velocity", "force")
        )
        found, unsolved = self.contact_step.play(pose[0], twist, places[:, 0], speeds[:, 0], np.swapaxes(forces, 0, 1))
        return DrivenReplay(found, *self._from_goal(found[-1]), unsolved)

    def simulate(self, pose: Array, velocity: Array, wrench: Array) -> Array:
        """The object's motion under given wrenches, by implicit Euler steps: shape (T + 1, 3).

        Parameters
        ----------
        pose, velocity : array, shape (3,)
            At the start.
        wrench : array, shape (T, 3)
            Force and moment over each step: newtons, newton metres.
        """
        poses, twist = [np.asarray(pose, dtype=float)], np.asarray(velocity, dtype=float)
        for pushed in wrench:
            twist = self._implicit_step(twist, pushed)
            poses.append(poses[-1] + self.step * twist)
        return np.array(poses)

    def _implicit_step(self, before: Array, pushed: Array) -> Array:
        """Solves ``M (u - before) = step (pushed + resistance(u))`` by a damped Newton iteration."""
        scale = self.step / self._inertia
        shifts = np.vstack([np.zeros(3), 1e-7 * np.eye(3)])

        def residual(u: Array) -> Array:
            return u - before - scale * (pushed + self._resistance(u))

        u = before + scale * pushed
        for _ in range(_NEWTON_STEPS):
            # One evaluation for the residual and its derivatives, which are differences.
            value, *shifted = residual(u + shifts)
            size = np.abs(value).max()
            if size < 1e-13:
                break
            change = np.linalg.solve((np.array(shifted) - value).T / 1e-7, -value)
            # Resistance saturates, so that a full step may overshoot; a residual that grows is not accepted.
            share = 1.0
            while share > 1e-3 and np.abs(residual(u + share * change)).max() >= size:
                share /= 2
            u = u + share * change
        return u

    @property
    def _inertia(self) -> Array:
        return np.array([self.body.mass, self.body.mass, self.body.inertia])

    def _resistance(self, twist: Array) -> Array:
        """Force and moment on the object at velocities of shape (3,) or (n, 3)."""
        if self.body.resistance is None:
            return np.zeros_like(twist)
        return np.array(self.body.resistance.wrench(self.body.mass, *twist.T)).T

    def _wrench(self, pose: Array, robots: Mapping[str, PlannedDisc]) -> Array:
        """Of the robots' own forces on the planned object, shape (T, 3)."""
        wrench = np.zeros((len(pose) - 1, 3))
        for robot in robots.values():
            ends = PlanarGap(*(entry[1:] for entry in self._gap(robot, pose)))
            wrench += np.column_stack(contact_wrench_on_body(ends, robot.normal, robot.along - robot.against))
        return wrench

    def _gap(self, robot: PlannedDisc, pose: Array) -> PlanarGap:
        (x, y), (q_x, q_y, theta) = robot.position.T, pose.T
        return self.body.shape.gap_to_disc(self.robot.shape.radius, x, y, (q_x, q_y, theta))

    def _velocity(self, robot: PlannedDisc) -> Array:
        """Of the robot at the element boundaries, from its positions; shape (T + 1, 2)."""
        return np.vstack([robot.velocity[:1], np.diff(robot.position, axis=0) / self.step])

    def _missing_force(self, robot: PlannedDisc, contact: Array) -> float:
        needed = self.robot.mass * np.diff(self._velocity(robot), axis=0) / self.step
        return float(np.linalg.norm(needed - robot.force - contact, axis=1).max())

    def _products(self, robot: PlannedDisc, at: PlanarGap, twist: Array) -> tuple[float, float, float]:
        """Largest gap, friction and separation product of one robot's contact."""
        w_n, w_t = slip_velocity(at, tuple(self._velocity(robot).T), tuple(twist.T))
        c, along, against = robot.normal, robot.along, robot.against
        slip = w_t[1:]
        friction = np.abs(
            [
                along * (np.abs(slip) + slip),
                against * (np.abs(slip) - slip),
                np.abs(slip) * (self.friction * c - along - against),
            ]
        )
        gap = at.gap[:-1] if self.restitution else at.gap[1:]
        separation = c * (w_n[1:] + self.restitution * w_n[:-1])
        return float(np.abs(c * gap).max()), float(friction.max()), float(np.abs(separation).max())

    def _from_goal(self, pose: Array) -> tuple[float, float]:
        off = np.array([distance_outside(float(at), wanted) for at, wanted in zip(pose, self.goal, strict=True)])
        # A whole turn more or less is the same pose.
        turn = (off[2] + np.pi) % (2 * np.pi) - np.pi
        return float(np.hypot(off[0], off[1])), float(np.degrees(abs(turn)))
