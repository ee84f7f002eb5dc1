"""Scores of combined plans, computed from arrays with laws of their own: what is the same in the plane and in space."""

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

from .physical_score import (
    PUSHING,
    PhysicalScore,
    bound_excess,
    excess,
    plan_component,
    smallest_distance,
)
from .planar_bodies import check_positive

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

    # Names of the coordinates of a robot, of its tangential unknowns, and of what is read of the object.
    _AXES: ClassVar[tuple[str, ...]]
    _TANGENTIAL: ClassVar[tuple[str, ...]]
    _OF_OBJECT: ClassVar[tuple[str, ...]]

    def __post_init__(self) -> None:
        check_positive(self, "friction", "step")

    @property
    def robot_components(self) -> tuple[str, ...]:
        """What is read of a robot's plan."""
        motion = [f"me.{kind}{axis}" for kind in ("", "v", "tau_") for axis in self._AXES]
        return (*motion, "me.c", *(f"me.{name}" for name in self._TANGENTIAL))

    @property
    def hub_components(self) -> tuple[str, ...]:
        """What is read of the object's plan; where the object has no agent of its own, of each robot's copy."""
        return tuple(f"body.{name}" for name in self._OF_OBJECT)

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

    def combined(self, plans: Mapping[str, Mapping[str, Array]]) -> tuple[Any, dict[str, PlannedRobot]]:
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
        return bodies[0] if len(bodies) == 1 else self._mean_of(bodies), robots

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
            body = self._simulated(body, self._sum_of_wrenches(body, robots))
        position = body.position
        bodies = [self._body_path(body)]
        level = np.tile(np.eye(position.shape[1]), (len(position), 1, 1))
        outline = self.robot.shape.outline()
        for name, robot in robots.items():
            at = self._gap(robot, body)
            force = self._wrench(robot, at)[:, : position.shape[1]]
            # A force lasts over an element; the start shows that of the first.
            force, contact = np.vstack([force[:1], force]), position + self._contact_point(at)
            bodies.append(BodyPath(outline, level, robot.position, name, force, contact))
        return np.linspace(0.0, self.step * (len(position) - 1), len(position)), bodies

    def animate(
        self, plans: Mapping[str, Mapping[str, Array]], path: str | Path | None = None, **options: Any
    ) -> AnimationFile:
        """Write an animation of a combined plan, with the options of `animate_scene`; in a notebook, it plays."""
        time, bodies = self.paths(plans)
        return animate_scene(time, bodies, (), path, **options)

    def _of_plan(self, body: Any, robots: Mapping[str, PlannedRobot]) -> PhysicalScore:
        """Score one combined plan."""
        axes = len(self._AXES)
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
        missing = self._missing_wrench(body, twist, wrench)
        simulated = self._simulated(body, wrench)
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
        def columns(names: Sequence[str]) -> Array:
            return np.column_stack([plan_component(name, plan, f"me.{each}") for each in names])

        position, velocity, force = (columns([kind + axis for axis in self._AXES]) for kind in ("", "v", "tau_"))
        return PlannedRobot(position, velocity, force, plan_component(name, plan, "me.c"), columns(self._TANGENTIAL))

    def _sum_of_wrenches(self, body: Any, robots: Mapping[str, PlannedRobot]) -> Array:
        """Of the robots' own forces on the body, shape (T, 3) or (T, 6)."""
        total: Array = np.sum([self._wrench(robot, self._gap(robot, body)) for robot in robots.values()], axis=0)
        return total

    def _velocity(self, robot: PlannedRobot) -> Array:
        """Of the robot at the element boundaries, from its positions; shape (T + 1, d)."""
        return np.vstack([robot.velocity[:1], np.diff(robot.position, axis=0) / self.step])

    def _missing_force(self, robot: PlannedRobot, contact: Array) -> float:
        needed = self.robot.mass * (np.diff(self._velocity(robot), axis=0) / self.step - self.robot.falling)
        return float(np.linalg.norm(needed - robot.force - contact, axis=1).max())

    def _products(self, robot: PlannedRobot, at: Any, twist: Array) -> tuple[float, ...]:
        """Largest gap, friction and separation product of one robot's contact."""
        w_n, w = self._slips(at, self._velocity(robot), twist)
        along = np.vstack([w, -w])[:, 1:].T
        speed = np.abs(along).max(axis=1, keepdims=True)
        c, alphas = robot.normal, robot.tangential
        left = self.friction * c - alphas.sum(axis=1)
        friction = np.column_stack([alphas * (speed + along), speed * left[:, None]])
        return tuple(float(np.abs(product).max()) for product in (c * at.gap[1:], friction, c * w_n[1:]))

    @abstractmethod
    def _body_of(self, name: str, plan: Mapping[str, Array]) -> Any:
        """The planned body of an agent: its `position`, and its `twist` of a step."""

    @abstractmethod
    def _mean_of(self, bodies: Sequence[Any]) -> Any:
        """Of copies of one planned body."""

    @abstractmethod
    def _body_path(self, body: Any) -> BodyPath:
        """What is drawn of the object."""

    @abstractmethod
    def _simulated(self, body: Any, wrench: Array) -> Any:
        """The object's motion from the start of a plan under given wrenches."""

    @abstractmethod
    def _missing_wrench(self, body: Any, twist: Array, wrench: Array) -> Array:
        """What the object would need beside the robots' wrenches and what acts on it anyway, shape of `wrench`."""

    @abstractmethod
    def _gap(self, robot: PlannedRobot, body: Any) -> Any: ...

    @abstractmethod
    def _contact_point(self, at: Any) -> Array:
        """From the body's origin, shape (T + 1, d)."""

    @abstractmethod
    def _wrench(self, robot: PlannedRobot, at: Any) -> Array:
        """The robot's own wrench on the body over each element, kinematics at its end."""

    @abstractmethod
    def _slips(self, at: Any, velocity: Array, twist: Array) -> tuple[Array, Array]:
        """Separating speed, shape (T + 1,), and slip along each tangent, shape (d - 1, T + 1)."""

    @abstractmethod
    def _from_goal(self, body: Any) -> tuple[float, float]:
        """Distance and angle at the end: metres, degrees."""


def implicit_step(residual: Callable[[Array], Array], start: Array) -> Array:
    """Velocities (3,) at which a residual (3,) is zero, by a damped Newton iteration with differences."""
    u = start
    for _ in range(_NEWTON_STEPS):
        value = residual(u)
        size = np.abs(value).max()
        if size < 1e-13 * (1 + np.abs(u).max()):
            break
        slopes = np.column_stack([(residual(u + shift) - value) / 1e-7 for shift in 1e-7 * np.eye(3)])
        change = np.linalg.solve(slopes, -value)
        # Resistance saturates, so that a full step may overshoot; a residual that grows is not accepted.
        share = 1.0
        while share > 1e-3 and np.abs(residual(u + share * change)).max() >= size:
            share /= 2
        u = u + share * change
    return u
