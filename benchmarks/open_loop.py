"""Plans in the plane played back open loop: driving forces alone, and whatever contact makes of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from pyrobocop_pyomo.mechanics import planar
from pyrobocop_pyomo.mechanics.rotations import rotation_vector
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.mixed_complementarity import (
    ComplementarityValues,
    MixedComplementarity,
    solve_mixed_complementarity,
)

_DIFFERENCE = 1e-7
# Of a robot: its velocity, and its forces c, alpha_plus, alpha_minus and slip, as in the contact.
_OF_ROBOT = 6


def play_back(score: planar.Score, plans: Mapping[str, Mapping[str, Array]]) -> tuple[Array, int | None]:
    """The object's poses where robots and object start as planned and move under driving forces and contact alone.

    Forces of contact and the planned paths are not read. Contact may have several solutions, and small errors choose
    among them: this says how robust a plan is, and nothing of its validity. The second is the first step without a
    solution, from which on the object stands still.
    """
    body, robots = score.combined(plans)
    places, speeds, forces = (
        np.array([getattr(robot, name) for robot in robots.values()]) for name in ("position", "velocity", "force")
    )
    pose = np.array([*body.position[0], *rotation_vector(body.rotation[0])])
    return ContactStep.of_score(score).play(
        pose, body.twist_at_start, places[:, 0], speeds[:, 0], np.swapaxes(forces, 0, 1)
    )


@dataclass(frozen=True)
class ContactStep:
    """One implicit step of a body and disc robots in contact, as a mixed complementarity problem.

    Attributes
    ----------
    body : RigidBody
    robot : DiscRobot
    friction, step : float
    """

    body: planar.RigidBody
    robot: planar.DiscRobot
    friction: float
    step: float

    @classmethod
    def of_score(cls, score: planar.Score) -> ContactStep:
        """With the bodies of a score."""
        return cls(score.body, score.robot, score.friction, score.step)

    def resistance(self, twist: Array) -> Array:
        """Force and moment on the body at velocities of shape (n, 3)."""
        if self.body.resistance is None:
            return np.zeros_like(twist)
        return np.array(self.body.resistance.wrench(self.body.mass, *twist.T)).T

    def solve(
        self,
        pose: Array,
        twist: Array,
        places: Array,
        speeds: Array,
        forces: Array,
        guess: Array,
    ) -> tuple[Array, bool]:
        """Unknowns at the end of the step, from poses and velocities at its start and the driving forces."""
        count = len(places)
        rows = 3 + 2 * count
        radius, start = self.robot.shape.radius, tuple(pose)
        contact = planar.Contact(self.body.shape, self.robot.shape, self.friction)
        before = [self.body.shape.gap_to_disc(radius, x, y, start) for x, y in places.tolist()]

        def sides(z: Array, frozen: bool) -> Array:
            """All equations, then both sides of all pairs, at points of shape (k, n)."""
            u, own = z[:, :3], z[:, 3:].reshape(len(z), count, _OF_ROBOT)
            after = pose + self.step * u
            inertia = np.array([self.body.mass, self.body.mass, self.body.inertia])
            missing = inertia * (u - twist) / self.step - self.resistance(u)
            equations, first, second = [missing], [], []
            for i in range(count):
                v, (c, along, against, slip) = own[:, i, :2], own[:, i, 2:].T
                at = before[i]
                if frozen:
                    w_n, w_t = contact.velocity(at, v.T, u.T)
                    at = at._replace(gap=at.gap + self.step * w_n)
                else:
                    x, y = (places[i] + self.step * v).T
                    at = self.body.shape.gap_to_disc(radius, x, y, tuple(after.T))
                    w_t = contact.velocity(at, v.T, u.T)[1]
                wrench = np.column_stack(contact.wrench_on_body(at, c, [along - against]))
                missing -= wrench
                equations.append(self.robot.mass * (v - speeds[i]) / self.step - forces[i] + wrench[:, :2])
                # The gap over the step is a speed, as the other sides are.
                first += [at.gap / self.step, slip + w_t, slip - w_t, self.friction * c - along - against]
                second += [c, along, against, slip]
            return np.hstack([*equations, np.column_stack(first), np.column_stack(second)])

        def evaluate(z: Array, frozen: bool) -> ComplementarityValues:
            value, *shifted = sides(z + np.vstack([np.zeros_like(z), _DIFFERENCE * np.eye(len(z))]), frozen)
            slopes = (np.array(shifted) - value).T / _DIFFERENCE
            cuts = [rows, rows + 4 * count]
            return ComplementarityValues(*np.split(value, cuts), *np.split(slopes, cuts))

        pairs = np.zeros(4 * count)
        # First with normals and contact points as they are at the start: there no robot can jump over the body.
        for frozen in (True, False):
            problem = MixedComplementarity(partial(evaluate, frozen=frozen), pairs, pairs + np.inf, pairs.astype(bool))
            found = solve_mixed_complementarity(problem, guess, tolerance=1e-7)
            guess = found.point
        return found.point, found.solved

    def play(self, pose: Array, twist: Array, places: Array, speeds: Array, forces: Array) -> tuple[Array, int | None]:
        """The object's poses, shape (T + 1, 3), under driving forces of shape (T, robots, 2); and the first step that
        found no solution.
        """
        poses, unknowns = [pose], np.zeros(3 + _OF_ROBOT * len(places))
        for number, driving in enumerate(forces):
            unknowns, solved = self.solve(poses[-1], twist, places, speeds, driving, unknowns)
            if not solved:
                return np.array(poses + [poses[-1]] * (len(forces) - number)), number
            twist, speeds = unknowns[:3].copy(), unknowns[3:].reshape(len(places), _OF_ROBOT)[:, :2].copy()
            poses.append(poses[-1] + self.step * twist)
            places = places + self.step * speeds
        return np.array(poses), None
