"""The equations of a phase and the pose of one body in the plane, solved for what gives a motion of the body."""

from __future__ import annotations

from typing import Any

import numpy as np

from pyrobocop_pyomo.geometry import Pose
from pyrobocop_pyomo.motion.phase_rates import SAMPLES, PhaseRates
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.least_squares import DIFFERENCE


class BodyEquations(PhaseRates):
    """The explicit equations of a phase and the pose of a body, as functions of arrays.

    Parameters
    ----------
    block : ObstacleAvoidanceBlockData
    phase : PhaseBlockData
    body : str

    Attributes
    ----------
    pose : Pose
    pose_states : list of str
        What the pose reads of the phase.
    place : list of str or None
        The variables that are x and y of the pose; None where an expression is.
    """

    def __init__(self, block: Any, phase: Any, body: str) -> None:
        super().__init__(phase)
        self.pose: Pose = block.motion.pose_at_node(block.record.scene.bodies[body].pose, self.time, name=body)
        self.pose_states = self.read(self.pose.entries)
        self.place = [self.name_of(entry) for entry in self.pose.translation]

    def pose_values(self, values: dict[str, Array], count: int) -> Array:
        """x, y and angle, ``(count, 3)``."""
        return self.evaluated([*self.pose.translation, self.pose.angles[0]], values, count)

    def pose_jacobian(self, values: dict[str, Array], count: int) -> Array:
        """Derivatives of x, y and angle by the states that they read, ``(count, 3, states)``."""
        columns = []
        for name in self.pose_states:
            step = DIFFERENCE * np.maximum(1.0, np.abs(values[name]))
            ahead, behind = values | {name: values[name] + step}, values | {name: values[name] - step}
            columns.append((self.pose_values(ahead, count) - self.pose_values(behind, count)) / (2.0 * step)[:, None])
        return np.stack(columns, axis=2)

    def velocities(self, values: dict[str, Array]) -> Array:
        """Velocities of the body in its own frame, ``(samples, 3)``: along its two axes, and its turn."""
        rates = self.evaluated([self.rates[name] for name in self.pose_states], values, SAMPLES)
        world = np.einsum("kij,kj->ki", self.pose_jacobian(values, SAMPLES), rates)
        angle = self.pose_values(values, SAMPLES)[:, 2]
        cosine, sine = np.cos(angle), np.sin(angle)
        return np.column_stack([
            cosine * world[:, 0] + sine * world[:, 1], cosine * world[:, 1] - sine * world[:, 0], world[:, 2],
        ])  # fmt: skip

    def states_and_controls(self, target: Array, rates: Array, times: Array) -> dict[str, Array] | None:
        """Values over time with which the body has the poses and velocities given; None where there are none.

        States of the pose follow from the poses, then what their rates read, then what the rates of these read.
        """
        count = len(times)
        known = {name: np.full(count, float(self.variables[name].value or 0.0)) for name in self.pose_states}
        known = self.solved(self.pose_states, known, [*self.pose.translation, self.pose.angles[0]], target)
        error = self.pose_values(known, count) - target
        if not np.abs(error).max() <= 1e-6 * max(1.0, float(np.abs(target).max())):
            return None
        wanted = np.linalg.solve(self.pose_jacobian(known, count), rates[:, :, None])[:, :, 0]
        return self.driven(self.pose_states, known, np.asarray(wanted, dtype=np.float64), times)
