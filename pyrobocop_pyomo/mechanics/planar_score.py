"""The physical score of a combined plan in the plane."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.plotting import BodyPath

from .physical_score import distance_outside, plan_component
from .plan_score import CombinedPlanScore, PlannedRobot, implicit_step
from .planar_bodies import POSE, TWIST, DiscRobot, PlanarBody
from .planar_contacts import contact_wrench_on_body, slip_velocity
from .planar_shapes import PlanarGap


@dataclass(frozen=True, eq=False)
class PlannedPlanarBody:
    """The object of a combined plan.

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

    def twist(self, step: float) -> Array:
        """Velocities that lead from pose to pose, shape (T + 1, 3)."""
        return np.vstack([self.velocity_at_start, np.diff(self.pose, axis=0) / step])


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

    _AXES = ("x", "y")
    _TANGENTIAL = ("alpha_plus", "alpha_minus")
    _OF_OBJECT = (*POSE, *TWIST)

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
        """Solves ``M (u - before) = step (pushed + resistance(u))``."""
        scale = self.step / self._inertia
        return implicit_step(lambda u: u - before - scale * (pushed + self._resistance(u)), before + scale * pushed)

    @property
    def _inertia(self) -> Array:
        return np.array([self.body.mass, self.body.mass, self.body.inertia])

    def _resistance(self, twist: Array) -> Array:
        """Force and moment on the object at velocities of shape (3,) or (n, 3)."""
        if self.body.resistance is None:
            return np.zeros_like(twist)
        return np.array(self.body.resistance.wrench(self.body.mass, *twist.T)).T

    def _body_of(self, name: str, plan: Mapping[str, Array]) -> PlannedPlanarBody:
        pose, twist = (
            np.column_stack([plan_component(name, plan, f"body.{each}") for each in names]) for names in (POSE, TWIST)
        )
        # Copies are kinematic: their velocities live on elements, so that the start of the object is taken as rest.
        return PlannedPlanarBody(pose, twist[0] if len(twist) == len(pose) else np.zeros(3))

    def _mean_of(self, bodies: Sequence[PlannedPlanarBody]) -> PlannedPlanarBody:
        poses, starts = zip(*((body.pose, body.velocity_at_start) for body in bodies), strict=True)
        return PlannedPlanarBody(np.mean(poses, axis=0), np.mean(starts, axis=0))

    def _body_path(self, body: PlannedPlanarBody) -> BodyPath:
        x, y, theta = body.pose.T
        return BodyPath.planar(self.body.shape.outline(), x, y, theta, name="")

    def _simulated(self, body: PlannedPlanarBody, wrench: Array) -> PlannedPlanarBody:
        return PlannedPlanarBody(self.simulate(body.pose[0], body.velocity_at_start, wrench), body.velocity_at_start)

    def _missing_wrench(self, body: PlannedPlanarBody, twist: Array, wrench: Array) -> Array:
        return self._inertia * np.diff(twist, axis=0) / self.step - wrench - self._resistance(twist[1:])

    def _gap(self, robot: PlannedRobot, body: PlannedPlanarBody) -> PlanarGap:
        (x, y), (q_x, q_y, theta) = robot.position.T, body.pose.T
        return self.body.shape.gap_to_disc(self.robot.shape.radius, x, y, (q_x, q_y, theta))

    def _contact_point(self, at: PlanarGap) -> Array:
        return np.column_stack([at.point_x, at.point_y])

    def _wrench(self, robot: PlannedRobot, at: PlanarGap) -> Array:
        ends = PlanarGap(*(entry[1:] for entry in at))
        along, against = robot.tangential.T
        return np.column_stack(contact_wrench_on_body(ends, robot.normal, along - against))

    def _slips(self, at: PlanarGap, velocity: Array, twist: Array) -> tuple[Array, Array]:
        w_n, w_t = slip_velocity(at, tuple(velocity.T), tuple(twist.T))
        return w_n, w_t[None]

    def _from_goal(self, body: PlannedPlanarBody) -> tuple[float, float]:
        end = body.pose[-1]
        off = np.array([distance_outside(float(at), wanted) for at, wanted in zip(end, self.goal, strict=True)])
        # A whole turn more or less is the same pose.
        turn = (off[2] + np.pi) % (2 * np.pi) - np.pi
        return float(np.hypot(off[0], off[1])), float(np.degrees(abs(turn)))
