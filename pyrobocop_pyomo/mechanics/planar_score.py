"""The physical score of a combined plan in the plane, computed from arrays with laws of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.numerics import Array

from .physical_score import distance_outside, plan_component
from .plan_score import PlannedRobot, PlanScore
from .planar_bodies import POSE, TWIST, DiscRobot, PlanarBody
from .planar_contacts import contact_wrench_on_body, slip_velocity
from .planar_replay import ContactStep, DrivenReplay
from .planar_shapes import PlanarGap

_NEWTON_STEPS = 60


@dataclass(frozen=True, eq=False)
class PlannedPose:
    """The object of a combined plan in the plane.

    Attributes
    ----------
    pose : array, shape (T + 1, 3)
        At the element boundaries: metres, radians.
    velocity_at_start : array, shape (3,)
    """

    pose: Array
    velocity_at_start: Array

    @property
    def position(self) -> Array:
        """Of its origin, shape (T + 1, 2)."""
        return self.pose[:, :2]

    @property
    def rotation(self) -> Array:
        """Rotation matrices, shape (T + 1, 2, 2)."""
        c, s = np.cos(self.pose[:, 2]), np.sin(self.pose[:, 2])
        return np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0)

    def twist(self, step: float) -> Array:
        """Velocities that lead from pose to pose, shape (T + 1, 3); the planned one first."""
        return np.vstack([self.velocity_at_start, np.diff(self.pose, axis=0) / step])


@dataclass(frozen=True)
class PlanarScore(PlanScore[PlannedPose]):
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

    _place: ClassVar = ("x", "y")
    _tangential: ClassVar = ("alpha_plus", "alpha_minus")
    _of_object: ClassVar = (*POSE, *TWIST)

    def _object_of(self, name: str, plan: Mapping[str, Array]) -> PlannedPose:
        pose = np.column_stack([plan_component(name, plan, f"body.{entry}") for entry in POSE])
        twist = np.column_stack([plan_component(name, plan, f"body.{entry}") for entry in TWIST])
        return PlannedPose(pose, twist[0] if len(twist) == len(pose) else np.zeros(3))

    def _mean_of(self, objects: Sequence[PlannedPose]) -> PlannedPose:
        poses, velocities = ([getattr(of, name) for of in objects] for name in ("pose", "velocity_at_start"))
        return PlannedPose(np.mean(poses, axis=0), np.mean(velocities, axis=0))

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
        planned, robots = self.combined(plans)
        places, speeds, forces = (
            np.array([getattr(robot, name) for robot in robots.values()]) for name in ("position", "velocity", "force")
        )
        found, unsolved = self.contact_step.play(
            planned.pose[0], planned.velocity_at_start, places[:, 0], speeds[:, 0], np.swapaxes(forces, 0, 1)
        )
        return DrivenReplay(found, *self._from_goal(PlannedPose(found, planned.velocity_at_start)), unsolved)

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

    def _simulated(self, planned: PlannedPose, wrench: Array) -> PlannedPose:
        start = planned.velocity_at_start
        return PlannedPose(self.simulate(planned.pose[0], start, wrench), start)

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

    def _missing_wrench(self, planned: PlannedPose, twist: Array, wrench: Array) -> Array:
        return self._inertia * np.diff(twist, axis=0) / self.step - wrench - self._resistance(twist[1:])

    def _gap(self, robot: PlannedRobot, planned: PlannedPose) -> PlanarGap:
        (x, y), (q_x, q_y, theta) = robot.position.T, planned.pose.T
        return self.body.shape.gap_to_disc(self.robot.shape.radius, x, y, (q_x, q_y, theta))

    def _wrench(self, at: PlanarGap, robot: PlannedRobot) -> Sequence[Array]:
        return contact_wrench_on_body(at, robot.normal, *robot.along)

    def _slip(self, at: PlanarGap, robot: Array, twist: Array) -> Sequence[Array]:
        return slip_velocity(at, tuple(robot), tuple(twist))

    def _from_goal(self, planned: PlannedPose) -> tuple[float, float]:
        last = planned.pose[-1].tolist()
        off = np.array([distance_outside(at, wanted) for at, wanted in zip(last, self.goal, strict=True)])
        # A whole turn more or less is the same pose.
        turn = (off[2] + np.pi) % (2 * np.pi) - np.pi
        return float(np.hypot(off[0], off[1])), float(np.degrees(abs(turn)))
