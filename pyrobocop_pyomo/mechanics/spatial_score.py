"""The physical score of a combined plan in space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.plotting import BodyPath

from .physical_score import distance_outside, plan_component
from .plan_score import CombinedPlanScore, PlannedRobot, implicit_step
from .rotations import inner_product, rotation_matrix, rotation_vector, tangents_across
from .spatial_bodies import POSITION, ROTATION, SPIN, VELOCITY, SpatialBody, SphereRobot
from .spatial_contacts import TANGENTIAL, slip_vector, spatial_wrench_on_body
from .spatial_shapes import SpatialGap


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

    _AXES = ("x", "y", "z")
    _TANGENTIAL = TANGENTIAL
    _OF_OBJECT = (*POSITION, *ROTATION, *VELOCITY, *SPIN)

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
        """Solves ``w - before = step a(w)`` with Euler's equations at the end of the step."""

        def residual(w: Array) -> Array:
            after = rotation_matrix(self.step * w) @ rotation
            left: Array = w - before - self.step * np.array(self.body.angular_acceleration(moment, w, after))
            return left

        start: Array = before + self.step * np.array(self.body.angular_acceleration(moment, before, rotation))
        return implicit_step(residual, start)

    def _body_of(self, name: str, plan: Mapping[str, Array]) -> PlannedBody:
        position, rotation, twist = (
            np.column_stack([plan_component(name, plan, f"body.{each}") for each in names])
            for names in (POSITION, ROTATION, (*VELOCITY, *SPIN))
        )
        # Copies are kinematic: their velocities live on elements, so that the start of the object is taken as rest.
        start = twist[0] if len(twist) == len(position) else np.zeros(6)
        return PlannedBody(position, rotation.reshape(-1, 3, 3), start[:3], start[3:])

    def _mean_of(self, bodies: Sequence[PlannedBody]) -> PlannedBody:
        at_each_time = zip(*(body.rotation for body in bodies), strict=True)
        means = [scipy.spatial.transform.Rotation.from_matrix(copies).mean() for copies in at_each_time]
        return PlannedBody(
            np.mean([body.position for body in bodies], axis=0),
            np.array([mean.as_matrix() for mean in means]),
            np.mean([body.velocity_at_start for body in bodies], axis=0),
            np.mean([body.spin_at_start for body in bodies], axis=0),
        )

    def _body_path(self, body: PlannedBody) -> BodyPath:
        return BodyPath(self.body.shape.outline(), body.rotation, body.position, "")

    def _simulated(self, body: PlannedBody, wrench: Array) -> PlannedBody:
        return self.simulate(body, wrench)

    def _missing_wrench(self, body: PlannedBody, twist: Array, wrench: Array) -> Array:
        rates = np.diff(twist, axis=0) / self.step
        force = self.body.mass * (rates[:, :3] + np.array([0.0, 0.0, self.body.gravity])) - wrench[:, :3]
        turned = body.rotation[1:]
        inertia = np.einsum("tij,j,tkj->tik", turned, np.array(self.body.moments), turned)
        spin = twist[1:, 3:]
        needed = np.einsum("tij,tj->ti", inertia, rates[:, 3:]) + np.cross(spin, np.einsum("tij,tj->ti", inertia, spin))
        return np.hstack([force, needed - wrench[:, 3:]])

    def _gap(self, robot: PlannedRobot, body: PlannedBody) -> SpatialGap:
        turned = np.moveaxis(body.rotation, 0, -1)
        return self.body.shape.gap_to_sphere(self.robot.shape.radius, robot.position.T, body.position.T, turned)

    def _contact_point(self, at: SpatialGap) -> Array:
        return np.column_stack(at.point)

    def _wrench(self, robot: PlannedRobot, at: SpatialGap) -> Array:
        ends = SpatialGap(*(entry[1:] for entry in at))
        along = robot.tangential[:, :2] - robot.tangential[:, 2:]
        tangents = tangents_across(ends.normal, self.never_normal)
        return np.column_stack(spatial_wrench_on_body(ends, tangents, robot.normal, along.T))

    def _slips(self, at: SpatialGap, velocity: Array, twist: Array) -> tuple[Array, Array]:
        slip = slip_vector(at, list(velocity.T), list(twist.T))
        tangents = tangents_across(at.normal, self.never_normal)
        return inner_product(at.normal, slip), np.array([inner_product(tangent, slip) for tangent in tangents])

    def _from_goal(self, body: PlannedBody) -> tuple[float, float]:
        position, turn = list(self.goal)[:3], list(self.goal)[3:]
        off = [distance_outside(float(at), wanted) for at, wanted in zip(body.position[-1], position, strict=True)]
        if turn == [None] * 3:
            return float(np.linalg.norm(off)), 0.0
        left = rotation_vector(body.rotation[-1] @ rotation_matrix(turn).T)
        return float(np.linalg.norm(off)), float(np.degrees(np.linalg.norm(left)))
