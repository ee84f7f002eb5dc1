"""The physical score of a combined plan in space, computed from arrays with laws of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import scipy

from .physical_score import distance_outside, plan_component
from .plan_score import PlannedRobot, PlanScore
from .rotations import inner_product, rotation_matrix, rotation_vector, tangents_across
from .spatial_bodies import POSITION, ROTATION, SPIN, VELOCITY, SpatialBody, SphereRobot
from .spatial_contacts import TANGENTIAL, slip_vector, spatial_wrench_on_body
from .spatial_shapes import SpatialGap

_NEWTON_STEPS = 30


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
class SpatialScore(PlanScore[PlannedBody]):
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
    never_normal: tuple[float, float, float] = field(default=(0.0, 0.0, 1.0), kw_only=True)

    _place: ClassVar = ("x", "y", "z")
    _tangential: ClassVar = TANGENTIAL
    _of_object: ClassVar = (*POSITION, *ROTATION, *VELOCITY, *SPIN)

    @property
    def _force_limits(self) -> Sequence[tuple[float, float]]:
        return self.robot.force_limits

    @property
    def _gravity(self) -> Array:
        return np.array([0.0, 0.0, -self.robot.gravity])

    def _object_of(self, name: str, plan: Mapping[str, Array]) -> PlannedBody:
        columns = np.column_stack([plan_component(name, plan, component) for component in self.hub_components[:12]])
        twist = np.column_stack([plan_component(name, plan, component) for component in self.hub_components[12:]])
        start = twist[0] if len(twist) == len(columns) else np.zeros(6)
        return PlannedBody(columns[:, :3], columns[:, 3:].reshape(-1, 3, 3), start[:3], start[3:])

    def _mean_of(self, objects: Sequence[PlannedBody]) -> PlannedBody:
        names = ("position", "velocity_at_start", "spin_at_start")
        position, velocity, spin = (np.mean([getattr(of, name) for of in objects], axis=0) for name in names)
        copies = zip(*(of.rotation for of in objects), strict=True)
        means = [scipy.spatial.transform.Rotation.from_matrix(each).mean().as_matrix() for each in copies]
        return PlannedBody(position, np.array(means), velocity, spin)

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

    def _simulated(self, planned: PlannedBody, wrench: Array) -> PlannedBody:
        return self.simulate(planned, wrench)

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

    def _missing_wrench(self, planned: PlannedBody, twist: Array, wrench: Array) -> Array:
        rates = np.diff(twist, axis=0) / self.step
        force = self.body.mass * (rates[:, :3] + np.array([0.0, 0.0, self.body.gravity])) - wrench[:, :3]
        turned = planned.rotation[1:]
        inertia = np.einsum("tij,j,tkj->tik", turned, np.array(self.body.moments), turned)
        spin = twist[1:, 3:]
        needed = np.einsum("tij,tj->ti", inertia, rates[:, 3:]) + np.cross(spin, np.einsum("tij,tj->ti", inertia, spin))
        return np.hstack([force, needed - wrench[:, 3:]])

    def _gap(self, robot: PlannedRobot, planned: PlannedBody) -> SpatialGap:
        turned = np.moveaxis(planned.rotation, 0, -1)
        return self.body.shape.gap_to_sphere(self.robot.shape.radius, robot.position.T, planned.position.T, turned)

    def _wrench(self, at: SpatialGap, robot: PlannedRobot) -> Sequence[Array]:
        tangents = tangents_across(at.normal, self.never_normal)
        return spatial_wrench_on_body(at, tangents, robot.normal, robot.along)

    def _slip(self, at: SpatialGap, robot: Array, twist: Array) -> Sequence[Array]:
        slip = slip_vector(at, list(robot), list(twist))
        return [inner_product(axis, slip) for axis in (at.normal, *tangents_across(at.normal, self.never_normal))]

    def _from_goal(self, planned: PlannedBody) -> tuple[float, float]:
        position, turn = list(self.goal)[:3], list(self.goal)[3:]
        off = [distance_outside(float(at), wanted) for at, wanted in zip(planned.position[-1], position, strict=True)]
        if turn == [None] * 3:
            return float(np.linalg.norm(off)), 0.0
        left = rotation_vector(planned.rotation[-1] @ rotation_matrix(turn).T)
        return float(np.linalg.norm(off)), float(np.degrees(np.linalg.norm(left)))
