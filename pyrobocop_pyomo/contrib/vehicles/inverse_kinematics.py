"""States and controls of a phase at which bodies in the plane have given poses and velocities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pyrobocop_pyomo.contrib.robots.inverse_dynamics import SAMPLES, InverseDynamics
from pyrobocop_pyomo.contrib.robots.least_squares import DIFFERENCE
from pyrobocop_pyomo.geometry import Pose
from pyrobocop_pyomo.modeling.expression_arrays import plain_entry
from pyrobocop_pyomo.numerics import Array


def heading_of(pose: Pose) -> Any:
    """The angle of a pose in the plane, which may consist of poses in each other's frames."""
    return sum(map(plain_entry, pose.angles))


class InverseKinematics(InverseDynamics):
    """The poses of bodies, solved for the states that they read, and the equations of these for their controls.

    Parameters
    ----------
    block : ObstacleAvoidanceBlockData
    phase : PhaseBlockData
    bodies : sequence of str

    Attributes
    ----------
    poses : list of Pose
    headings : list of expression
        Their angles.
    pose_states : list of str
        What the poses read of the phase.
    place : list of str or None
        The variables that are x and y of the first pose; None where an expression is.
    """

    def __init__(self, block: Any, phase: Any, bodies: Sequence[str]) -> None:
        super().__init__(phase)
        self.poses: list[Pose] = [
            block.motion.pose_at_node(block.record.scene.bodies[body].pose, self.time, name=body) for body in bodies
        ]
        self.pose_states = self.read([entry for pose in self.poses for entry in pose.entries])
        names = {id(variable): name for name, variable in self.variables.items()}
        self.place = [names.get(id(entry)) for entry in self.poses[0].translation]
        self.headings = [heading_of(pose) for pose in self.poses]
        self._numbers = [entry for pose in self.poses for entry in (*pose.translation, heading_of(pose))]

    def pose_values(self, values: dict[str, Array], count: int) -> Array:
        """x, y and angle of each body, ``(count, 3 bodies)``."""
        return self.evaluated(self._numbers, values, count)

    def pose_jacobian(self, values: dict[str, Array], count: int) -> Array:
        """Derivatives of all x, y and angles by the states that they read, ``(count, 3 bodies, states)``."""
        columns = []
        for name in self.pose_states:
            step = DIFFERENCE * np.maximum(1.0, np.abs(values[name]))
            ahead, behind = values | {name: values[name] + step}, values | {name: values[name] - step}
            columns.append((self.pose_values(ahead, count) - self.pose_values(behind, count)) / (2.0 * step)[:, None])
        return np.stack(columns, axis=2)

    def velocities(self, values: dict[str, Array]) -> Array:
        """Velocities of each body in its own frame, ``(samples, bodies, 3)``: along its two axes, and its turn."""
        rates = self.evaluated([self.rates[name] for name in self.pose_states], values, SAMPLES)
        world = np.einsum("kij,kj->ki", self.pose_jacobian(values, SAMPLES), rates)
        angle = self.pose_values(values, SAMPLES)[:, 2::3]
        cosine, sine, x, y = np.cos(angle), np.sin(angle), world[:, ::3], world[:, 1::3]
        return np.stack([cosine * x + sine * y, cosine * y - sine * x, world[:, 2::3]], axis=-1)

    def states_and_controls(self, target: Array, rates: Array, times: Array) -> dict[str, Array] | None:
        """Values over time with which bodies have the poses and velocities given; None where there are none.

        States of the poses follow from the poses, then what their rates read, then what the rates of these read.
        """
        count = len(times)
        known = {name: np.full(count, float(self.variables[name].value or 0.0)) for name in self.pose_states}
        known = self.solved(self.pose_states, known, self._numbers, target)
        error = self.pose_values(known, count) - target
        if not np.abs(error).max() <= 1e-6 * max(1.0, float(np.abs(target).max())):
            return None
        wanted = (np.linalg.pinv(self.pose_jacobian(known, count)) @ rates[:, :, None])[:, :, 0]
        return self.driven(self.pose_states, known, np.asarray(wanted, dtype=np.float64), times)
