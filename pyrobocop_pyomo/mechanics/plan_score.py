"""`PlanScore`: what scores of combined plans share in the plane and in space; laws of motion are the subclasses'."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Generic, Protocol, TypeVar

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


@dataclass(frozen=True, eq=False)
class PlannedRobot:
    """One robot of a combined plan, in d = 2 or 3 dimensions.

    Attributes
    ----------
    position, velocity : array, shape (T + 1, d)
        At the element boundaries.
    force : array, shape (T, d)
        Driving force over each element.
    normal : array, shape (T,)
        Its own contact force along the normal.
    tangential : array, shape (T, 2 (d - 1))
        Along each of the tangents, then against each of them.
    """

    position: Array
    velocity: Array
    force: Array
    normal: Array
    tangential: Array

    @property
    def along(self) -> Array:
        """Contact force along each tangent, shape (d - 1, T)."""
        ahead, against = np.split(self.tangential.T, 2)
        return np.asarray(ahead - against)


class PlannedObject(Protocol):
    """The object of a combined plan: its poses at the element boundaries."""

    @property
    def position(self) -> Array:
        """Of its origin, shape (T + 1, d)."""

    @property
    def rotation(self) -> Array:
        """Rotation matrices, shape (T + 1, d, d)."""

    def twist(self, step: float) -> Array:
        """Velocity and angular velocity that lead from pose to pose, shape (T + 1, 3 or 6); those planned first."""


Planned = TypeVar("Planned", bound=PlannedObject)


@dataclass(frozen=True)
class PlanScore(ABC, Generic[Planned]):
    """Scores combined plans of robots that push a body, by physics and never by the status of a solver.

    Nothing of the model is used: residuals are recomputed from poses, and the object is simulated by an implicit step
    of its own. Only the laws are the same.

    Attributes
    ----------
    body, robot : body and robot of the plans
        All robots are alike.
    friction : float
        Between robot and body.
    step : float
        Duration of an element, seconds.
    goal : sequence of number, pair (lower, upper) or None
        Where the object has to come to rest.
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

    body: Any
    robot: Any
    friction: float
    step: float
    goal: Sequence[float | tuple[float, float] | None]
    restitution: float = 0.0
    rest_at_end: bool = field(default=True, kw_only=True)
    bounds: Mapping[str, Mapping[str, tuple[float | None, float | None]]] = field(default_factory=dict, kw_only=True)

    # Names of what is read of a robot's plan and of the object's, without the names of their blocks.
    _place: ClassVar[tuple[str, ...]]
    _tangential: ClassVar[tuple[str, ...]]
    _of_object: ClassVar[tuple[str, ...]]

    def __post_init__(self) -> None:
        check_positive(self, "friction", "step")

    @property
    def robot_components(self) -> tuple[str, ...]:
        """What is read of a robot's plan."""
        velocity, force = ([f"{kind}{axis}" for axis in self._place] for kind in ("v", "tau_"))
        return tuple(f"me.{name}" for name in (*self._place, *velocity, *force, "c", *self._tangential))

    @property
    def hub_components(self) -> tuple[str, ...]:
        """What is read of the object's plan; where the object has no agent of its own, of each robot's copy."""
        return tuple(f"body.{name}" for name in self._of_object)

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

    def combined(self, plans: Mapping[str, Mapping[str, Array]]) -> tuple[Planned, dict[str, PlannedRobot]]:
        """Reads the combined plan: the object and, by name, the robots.

        The object's trajectory is that of the agent that is no robot. Where all agents are robots, it is the mean of
        their copies.
        """
        robots = {name: self._robot_of(name, plan) for name, plan in plans.items() if "me.x" in plan}
        if not robots:
            raise TrajectoryError(
                f"physical score: none of the plans of {', '.join(map(repr, plans))} has 'me.x', the motion of a robot."
            )
        holders = [name for name in plans if name not in robots] or list(robots)
        objects = [self._object_of(name, plans[name]) for name in holders]
        boundaries = len(objects[0].position)
        for name, robot in robots.items():
            if len(robot.position) != boundaries or len(robot.normal) != boundaries - 1:
                raise TrajectoryError(
                    f"physical score: the object of '{holders[0]}' has {boundaries} poses, '{name}' has "
                    f"{len(robot.position)} positions and {len(robot.normal)} forces; expected are {boundaries} and "
                    f"{boundaries - 1}."
                )
        return objects[0] if len(objects) == 1 else self._mean_of(objects), robots

    def _robot_of(self, name: str, plan: Mapping[str, Array]) -> PlannedRobot:
        columns = [plan_component(name, plan, component) for component in self.robot_components]
        axes = len(self._place)
        position, velocity, force = (np.column_stack(columns[first : first + axes]) for first in (0, axes, 2 * axes))
        return PlannedRobot(position, velocity, force, columns[3 * axes], np.column_stack(columns[3 * axes + 1 :]))

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
        planned, robots = self.combined(plans)
        shown = self._simulated(planned, sum(self._wrenches(planned, robots).values())) if simulated else planned
        count = len(planned.position)
        bodies = [BodyPath(self.body.shape.outline(), shown.rotation, shown.position, "")]
        level = np.tile(np.eye(len(self._place)), (count, 1, 1))
        outline = self.robot.shape.outline()
        bodies += [BodyPath(outline, level, robot.position, name) for name, robot in robots.items()]
        return np.linspace(0.0, self.step * (count - 1), count), bodies

    def animate(
        self, plans: Mapping[str, Mapping[str, Array]], path: str | Path | None = None, **options: Any
    ) -> AnimationFile:
        """Write an animation of a combined plan, with the options of `animate_scene`; in a notebook, it plays."""
        time, bodies = self.paths(plans)
        return animate_scene(time, bodies, (), path, **options)

    def of_plan(self, planned: Planned, robots: Mapping[str, PlannedRobot]) -> PhysicalScore:
        """Score one combined plan, as `combined` returns it."""
        axes = len(self._place)
        twist = planned.twist(self.step)
        gaps = {name: self._gap(robot, planned) for name, robot in robots.items()}
        wrenches = self._wrenches(planned, robots)
        wrench: Array = sum(wrenches.values())
        own_forces = [self._missing_force(robot, -wrenches[name][:, :axes]) for name, robot in robots.items()]
        products = [self._products(robot, gaps[name], twist) for name, robot in robots.items()]
        outside = [0.0]
        for robot in robots.values():
            left = self.friction * robot.normal - robot.tangential.sum(axis=1)
            outside += [float(-side.min()) for side in (robot.normal, robot.tangential, left)]
        missing = self._missing_wrench(planned, twist, wrench)
        simulated = self._simulated(planned, wrench)
        later = {name: self._gap(robot, simulated).gap for name, robot in robots.items()}
        pushed = [later[name][1:][robot.normal > PUSHING] for name, robot in robots.items()]
        gap_product, friction_product, separation_product = np.max(products, axis=0).tolist()
        distance, angle = self._from_goal(simulated)
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
            penetration=excess(np.array([at.gap for at in gaps.values()]), 0.0, None),
            goal_distance=distance,
            goal_angle=angle,
            gap_at_force=float(np.concatenate([np.zeros(1), *pushed]).max()),
            simulated_penetration=excess(np.array(list(later.values())), 0.0, None),
            distance=smallest_distance([robot.position for robot in robots.values()]),
            force_excess=excess(forces, *np.transpose(self._force_limits)),
            speed_excess=excess(speeds, -self.robot.speed_limit, self.robot.speed_limit),
            bound_excess=0.0,
            end_speed=float(np.linalg.norm(end[:axes])),
            end_spin=float(np.degrees(np.linalg.norm(end[axes:]))),
            robot_end_speed=float(np.linalg.norm(speeds[:, 0, -1], axis=1).max() * self.rest_at_end),
        )

    def _wrenches(self, planned: Planned, robots: Mapping[str, PlannedRobot]) -> dict[str, Array]:
        """Of each robot's own forces on the planned object, with the kinematics at element ends: shape (T, 3 or 6)."""
        found = {}
        for name, robot in robots.items():
            at = self._gap(robot, planned)
            found[name] = np.column_stack(self._wrench(type(at)(*(entry[1:] for entry in at)), robot))
        return found

    def _velocity(self, robot: PlannedRobot) -> Array:
        """Of the robot at the element boundaries, from its positions; shape (T + 1, d)."""
        return np.vstack([robot.velocity[:1], np.diff(robot.position, axis=0) / self.step])

    def _missing_force(self, robot: PlannedRobot, contact: Array) -> float:
        needed = self.robot.mass * (np.diff(self._velocity(robot), axis=0) / self.step - self._gravity)
        return float(np.linalg.norm(needed - robot.force - contact, axis=1).max())

    def _products(self, robot: PlannedRobot, at: Any, twist: Array) -> tuple[float, float, float]:
        """Largest gap, friction and separation product of one robot's contact."""
        w_n, *w_t = self._slip(at, self._velocity(robot).T, twist.T)
        w = np.array(w_t)[:, 1:]
        along = np.vstack([w, -w]).T
        speed = np.abs(w).max(axis=0)
        c, alphas = robot.normal, robot.tangential
        friction = np.column_stack(
            [alphas * (speed[:, None] + along), speed * (self.friction * c - alphas.sum(axis=1))]
        )
        gap = at.gap[:-1] if self.restitution else at.gap[1:]
        separation = c * (w_n[1:] + self.restitution * w_n[:-1])
        return float(np.abs(c * gap).max()), float(np.abs(friction).max()), float(np.abs(separation).max())

    # ---------------------------------------------------------------- the laws of motion

    @property
    def _force_limits(self) -> Sequence[tuple[float, float]]:
        """Lowest and highest driving force of a robot along each axis, newtons."""
        return [(-self.robot.force_limit, self.robot.force_limit)] * len(self._place)

    @property
    def _gravity(self) -> Array:
        """Acceleration of a robot that falls, shape (d,)."""
        return np.zeros(len(self._place))

    @abstractmethod
    def _simulated(self, planned: Planned, wrench: Array) -> Planned:
        """The object's motion from the start of a plan under given wrenches, by implicit Euler steps."""

    @abstractmethod
    def _object_of(self, name: str, plan: Mapping[str, Array]) -> Planned:
        """The object as an agent plans it.

        Copies are kinematic: their velocities live on elements, so that the start of the object is taken as rest.
        """

    @abstractmethod
    def _mean_of(self, objects: Sequence[Planned]) -> Planned:
        """The mean of several copies."""

    @abstractmethod
    def _gap(self, robot: PlannedRobot, planned: Planned) -> Any:
        """How a robot stands to the object at the element boundaries."""

    @abstractmethod
    def _wrench(self, at: Any, robot: PlannedRobot) -> Sequence[Array]:
        """Of a robot's own forces on the object: 3 or 6 components."""

    @abstractmethod
    def _slip(self, at: Any, robot: Array, twist: Array) -> Sequence[Array]:
        """Velocity of a robot relative to the object: along the normal, then along each tangent."""

    @abstractmethod
    def _missing_wrench(self, planned: Planned, twist: Array, wrench: Array) -> Array:
        """What the object would need beside the robots' wrenches and what else acts on it, shape (T, 3 or 6)."""

    @abstractmethod
    def _from_goal(self, planned: Planned) -> tuple[float, float]:
        """Distance and angle of the last pose from the goal: metres, degrees."""
