"""Bodies and robots that move in space: what a phase states of their motion.

On the implicit Euler scheme the equations are the impulse form of mechanics: momentum at the end of an element is
momentum at its start plus the impulse of the mean forces, and a body moves and turns with the velocities at its end.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases import Algebraic, Control, State

from .planar_bodies import (
    DrivenRobot,
    PushedBody,
    check_free,
    check_has,
    check_positive,
    entries_at,
    middle_of_goal,
)
from .rotations import (
    Matrix,
    Vector,
    cross_product,
    inner_product,
    rotation_matrix,
    rotation_vector,
    turn_matrix,
    turn_quaternion,
)
from .spatial_shapes import SpatialShape, Sphere

Place = Sequence[float | tuple[float, float] | None]

POSITION = ("qx", "qy", "qz")
ROTATION = tuple(f"R{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
VELOCITY = ("ux", "uy", "uz")
SPIN = ("wx", "wy", "wz")
TURN = ("turn_w", "turn_x", "turn_y", "turn_z")
SPATIAL_WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")


@dataclass(frozen=True)
class SpatialBody(PushedBody):
    """A rigid body in space.

    On a phase, its position is ``qx``, ``qy``, ``qz`` (metres), its rotation matrix ``R11`` to ``R33``, its velocity
    ``ux``, ``uy``, ``uz`` and its angular velocity ``wx``, ``wy``, ``wz`` (radians per second); a wrench on it is
    ``fx``, ``fy``, ``fz``, ``mx``, ``my``, ``mz``, force and moment about the origin of its frame, its centre of mass,
    as means over each element (newtons, newton metres). All are in the directions of the world.

    The rotation steps by the exponential map, ``R = exp([h w]x) R_before`` with the angular velocity at the end of an
    element of duration ``h``. So it stays a rotation to rounding, without a constraint that says so.

    Attributes
    ----------
    shape : Sphere, SpatialCapsule or SpatialBox
        Around the centre of mass.
    mass : float
        Kilograms.
    inertia : float or (float, float, float)
        About the centre of mass, kilogram square metres: the same about every axis, or the principal moments about the
        axes of the body's frame.
    gravity : float
        Metres per second squared, against the world's z axis.

    Examples
    --------
    >>> import pyrobocop_pyomo as rcp
    >>> spatial = rcp.mechanics.spatial
    >>> ball = spatial.RigidBody(spatial.Sphere(radius=0.2), mass=0.6, inertia=0.4 * 0.6 * 0.2**2)
    >>> round(ball.shape.gap_to_sphere(0.12, (0.0, 0.0, 0.5), (0.0, 0.0, 0.0)).gap, 3)
    0.18
    """

    shape: SpatialShape
    mass: float
    inertia: float | tuple[float, float, float]
    gravity: float = 9.81

    _WRENCH = SPATIAL_WRENCH

    def __post_init__(self) -> None:
        check_positive(self, "mass")
        moments = np.atleast_1d(np.asarray(self.inertia, dtype=float))
        if moments.shape not in ((1,), (3,)) or not (np.isfinite(moments) & (moments > 0)).all():
            raise ModelError(
                f"SpatialBody: inertia = {self.inertia!r}; expected a positive number or three, the principal moments."
            )
        if 2 * moments.max() > moments.sum() * (3 / len(moments)) * (1 + 1e-9):
            raise ModelError(
                f"SpatialBody: inertia = {self.inertia!r}; no body has a principal moment above the sum of the others."
            )
        if not np.isfinite(self.gravity):
            raise ModelError(f"SpatialBody: gravity = {self.gravity!r}; expected a number.")

    @property
    def moments(self) -> tuple[float, float, float]:
        """The three principal moments."""
        first, second, third = np.broadcast_to(np.asarray(self.inertia, dtype=float), 3).tolist()
        return first, second, third

    def angular_acceleration(self, moment: Vector, spin: Vector, rotation: Matrix) -> list[Any]:
        """Euler's equations in the directions of the world: ``R J^-1 (R'm - R'w x J R'w)``.

        Parameters
        ----------
        moment, spin : three numbers, arrays or expressions
            Moment on the body, newton metres, and angular velocity, radians per second.
        rotation : three rows of three entries
            Not read where the inertia is the same about every axis.
        """
        moments = self.moments
        if len(set(moments)) == 1:
            return [m / moments[0] for m in moment]
        columns = list(zip(*rotation, strict=True))
        turned = [inner_product(column, spin) for column in columns]
        gyroscopic = cross_product(turned, [j * w for j, w in zip(moments, turned, strict=True)])
        in_body = [(inner_product(c, moment) - g) / j for c, g, j in zip(columns, gyroscopic, moments, strict=True)]
        return [inner_product(row, in_body) for row in rotation]

    def state_motion(
        self,
        phase: Any,
        wrenches: Iterable[Any],
        *,
        start: Sequence[float],
        goal: Place | None = None,
        velocity_at_start: Sequence[float] = (0.0,) * 6,
    ) -> None:
        """State that the body moves under wrenches and gravity and, where it has a goal, comes to rest there.

        Parameters
        ----------
        phase : PhaseBlock
            On the implicit Euler scheme, with a duration that is a number. Gets the states of pose and velocity and
            their equations, and algebraics ``turn_w``, ``turn_x``, ``turn_y``, ``turn_z``, the quaternion of the turn
            over an element.
        wrenches : iterable of PhaseBlock
            Each with ``fx``, ``fy``, ``fz``, ``mx``, ``my``, ``mz`` on the same grid.
        start : (x, y, z, r_x, r_y, r_z)
            Position, metres, and rotation vector, axis times angle in radians.
        goal : (x, y, z, r_x, r_y, r_z), optional
            Where it comes to rest. A coordinate is a number, a pair (lower, upper), or None where any value will do;
            the rotation vector is three numbers, or three times None. The initial guess leads there on a straight line
            and by the shortest turn.
        velocity_at_start : (u_x, u_y, u_z, w_x, w_y, w_z)
            Metres and radians per second.

        Raises
        ------
        ModelError
            When a name is taken, a wrench lacks a component, grids differ, or the phase has a free duration.

        Notes
        -----
        The rotation has nine entries and three degrees of freedom: the steps keep it a rotation. Its goal is therefore
        stated by three equations, ``vee(G'R - R'G) = 0``, and ``trace(G'R) >= 2.99``, which leaves out the half turns
        that satisfy these too. Nine equations would be dependent.
        """
        wrenches = list(wrenches)
        check_free(
            phase, *POSITION, *ROTATION, *VELOCITY, *SPIN, *TURN, "newton_euler", "turn_over_element", "goal_rotation"
        )
        for wrench in wrenches:
            check_has(wrench, phase, *SPATIAL_WRENCH)
        path = _PoseGuess(phase, start, goal)
        final = [None] * 3 if goal is None else list(goal)[:3]
        for name, first, last, guess in zip(POSITION, path.first, final, path.positions.T, strict=True):
            phase.declare(name, State(initial=first, final=last, initial_guess=guess))
        resting = None if goal is None else 0.0
        speeds = [*path.velocity, *path.spin]
        for name, first, guess in zip((*VELOCITY, *SPIN), velocity_at_start, speeds, strict=True):
            phase.declare(name, State(initial=float(first), final=resting, initial_guess=guess))
        self._state_rotation(phase, path)
        weight = (0.0, 0.0, -self.gravity)

        @phase.ode
        def newton_euler(b: Any, t: float) -> dict[Any, Any]:
            total = [sum(getattr(wrench, name)[t] for wrench in wrenches) for name in SPATIAL_WRENCH]
            spin = entries_at(b, SPIN, t)
            turning = self.angular_acceleration(total[3:], spin, rotation_at(b, t))
            rates = dict(zip((b.qx, b.qy, b.qz), entries_at(b, VELOCITY, t), strict=True))
            rates |= {getattr(b, n): f / self.mass + g for n, f, g in zip(VELOCITY, total[:3], weight, strict=True)}
            return rates | {getattr(b, name): rate for name, rate in zip(SPIN, turning, strict=True)}

        if path.last is not None:
            _state_goal_rotation(phase, path.last)

    def state_copy(self, phase: Any, *, start: Sequence[float], goal: Place | None = None) -> None:
        """State a kinematic copy: the pose follows velocities that are chosen freely. Where it goes, others decide.

        Parameters
        ----------
        phase : PhaseBlock
            Gets the states of the pose, and the velocities as controls; a rotation matrix where the shape is not
            round, because a contact reads it only then.
        start : (x, y, z, r_x, r_y, r_z)
            Metres, radians.
        goal : (x, y, z, r_x, r_y, r_z), optional
            Where the initial guess leads; nothing is required of the end.

        Raises
        ------
        ModelError
            When a name is taken, or the phase has a free duration.
        """
        turns = not self.shape.is_round
        check_free(phase, *POSITION, *VELOCITY, *SPIN, "kinematic_copy")
        check_free(phase, *((*ROTATION, *TURN, "turn_over_element") if turns else ()))
        path = _PoseGuess(phase, start, goal)
        for name, first, guess in zip(POSITION, path.first, path.positions.T, strict=True):
            phase.declare(name, State(initial=first, initial_guess=guess))
        for name, guess in zip((*VELOCITY, *SPIN), [*path.velocity, *path.spin], strict=True):
            phase.declare(name, Control(initial_guess=guess))
        if turns:
            self._state_rotation(phase, path)

        @phase.ode
        def kinematic_copy(b: Any, t: float) -> dict[Any, Any]:
            return {b.qx: b.ux[t], b.qy: b.uy[t], b.qz: b.uz[t]}

    @staticmethod
    def _state_rotation(phase: Any, path: _PoseGuess) -> None:
        """Rotation states, which step by the quaternion of each element's turn."""
        for name, first, guess in zip(
            ROTATION, path.rotations[0].ravel(), path.rotations.reshape(-1, 9).T, strict=True
        ):
            phase.declare(name, State(initial=float(first), initial_guess=guess))
        widths = dict(zip(phase.points, phase.grid.mesh.widths.tolist(), strict=True))
        turns = [turn_quaternion([float(w) * width for w in path.spin]) for width in widths.values()]
        for name, guess in zip(TURN, np.array(turns, dtype=float).T, strict=True):
            phase.declare(name, Algebraic(initial_guess=guess))

        @phase.residual
        def turn_over_element(b: Any, t: float) -> dict[str, Any]:
            formulas = turn_quaternion([widths[t] * getattr(b, name)[t] for name in SPIN])
            return {name: getattr(b, name)[t] == formula for name, formula in zip(TURN, formulas, strict=True)}

        @phase.step_map
        def turn(b: Any, t: float, previous: Any) -> dict[Any, Any]:
            before = [[getattr(previous, name) for name in ROTATION[i : i + 3]] for i in (0, 3, 6)]
            after = turn_matrix(entries_at(b, TURN, t), before)
            return {
                getattr(b, name): entry
                for name, entry in zip(ROTATION, (entry for row in after for entry in row), strict=True)
            }


@dataclass(frozen=True)
class SphereRobot(DrivenRobot):
    """A robot that is a sphere and is driven by a force: a quadrotor without attitude, a point mass with a size.

    On a phase, its position is ``x``, ``y``, ``z``, its velocity ``vx``, ``vy``, ``vz``, its driving force ``tau_x``,
    ``tau_y``, ``tau_z``.

    Attributes
    ----------
    shape : Sphere
    mass : float
        Kilograms.
    force_limits : three pairs (lowest, highest)
        Of the driving force along each axis, newtons.
    speed_limit : float
        Largest velocity along each axis, metres per second.
    gravity : float
        Metres per second squared, against the world's z axis.
    """

    shape: Sphere
    mass: float
    force_limits: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    speed_limit: float
    gravity: float = 9.81

    _AXES = ("x", "y", "z")
    _WRENCH = SPATIAL_WRENCH

    def __post_init__(self) -> None:
        check_positive(self, "mass", "speed_limit")
        limits = np.asarray(self.force_limits, dtype=float)
        if limits.shape != (3, 2) or np.isnan(limits).any() or (limits[:, 0] > limits[:, 1]).any():
            raise ModelError(
                f"SphereRobot: force_limits = {self.force_limits!r}; expected a pair (lowest, highest) for each axis."
            )

    @property
    def driving_limits(self) -> Array:
        """Lowest and highest driving force along each axis, newtons."""
        return np.array(self.force_limits, dtype=float).T

    @property
    def falling(self) -> Array:
        """Acceleration by gravity along each axis, metres per second squared."""
        return np.array([0.0, 0.0, -self.gravity])


def rotation_at(phase: Any, t: float) -> list[list[Any]]:
    """Rows of the rotation matrix of a phase at a time index."""
    entries = entries_at(phase, ROTATION, t)
    return [entries[i : i + 3] for i in (0, 3, 6)]


def _state_goal_rotation(phase: Any, goal: Array) -> None:
    columns = goal.T.tolist()
    final = phase.final_time

    @phase.constraint_at_boundaries
    def goal_rotation(b: Any, t: float) -> Any:
        if t != final:
            return dict.fromkeys(("x", "y", "z", "trace"), Constraint.Skip)
        # Row i and column j of G'R: column i of the goal with column j of the rotation.
        reached = [[inner_product(g, r) for r in zip(*rotation_at(b, t), strict=True)] for g in columns]
        return {
            "x": reached[2][1] - reached[1][2] == 0,
            "y": reached[0][2] - reached[2][0] == 0,
            "z": reached[1][0] - reached[0][1] == 0,
            "trace": reached[0][0] + reached[1][1] + reached[2][2] >= 2.99,
        }


class _PoseGuess:
    """A straight line and the shortest turn between two poses, over the times of a phase.

    Attributes
    ----------
    first : list of float
        Position at the start.
    positions, rotations : array, shapes (T + 1, 3) and (T + 1, 3, 3)
    velocity, spin : list of three float
        Constant; with them the rotations satisfy the steps of the exponential map.
    last : array, shape (3, 3), or None
        Rotation of the goal.
    """

    def __init__(self, phase: Any, start: Sequence[float], goal: Place | None) -> None:
        if phase.has_normalised_time:
            raise ModelError(
                f"phase '{phase.name}': a body steps by the exponential map over elements whose durations are numbers. "
                "Give the phase a fixed start, duration and mesh."
            )
        for what, pose in (("start", start), ("goal", goal)):
            if pose is not None and len(pose) != 6:
                raise ModelError(
                    f"phase '{phase.name}': {what} = {pose!r}; expected (x, y, z, r_x, r_y, r_z), a position and a "
                    "rotation vector."
                )
        turn = None if goal is None else list(goal)[3:]
        self.first = [float(value) for value in list(start)[:3]]
        ends = (
            self.first
            if goal is None
            else [middle_of_goal(f, g) for f, g in zip(self.first, list(goal)[:3], strict=True)]
        )
        begins = rotation_matrix(list(start)[3:])
        self.last = None if turn is None or turn == [None] * 3 else rotation_matrix(turn)
        whole = np.zeros(3) if self.last is None else rotation_vector(self.last @ begins.T)
        times = np.array(list(phase.time))
        seconds = float(times[-1] - times[0])
        share = (times - times[0]) / seconds
        self.positions = np.array(self.first) + share[:, None] * (np.array(ends) - np.array(self.first))
        self.rotations = np.array([rotation_matrix(s * whole) @ begins for s in share])
        self.velocity = ((np.array(ends) - np.array(self.first)) / seconds).tolist()
        self.spin = (whole / seconds).tolist()
