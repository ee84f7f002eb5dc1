"""Bodies and robots that move in the plane or in space: what a phase states of their motion.

On the implicit Euler scheme the equations are the impulse form of mechanics: momentum at the end of an element is
momentum at its start plus the impulse of the mean forces, and a body moves and turns with the velocities at its end.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.expression import Expression
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.geometry.poses import dot
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases import Algebraic, Control, State

from .rotations import (
    Matrix,
    Vector,
    cross_product,
    rotation_matrix,
    rotation_rows,
    rotation_vector,
    turn_matrix,
    turn_quaternion,
)
from .shapes import PLANE, SPACE, Disc, PlanarShape, SpatialShape, Sphere, root

Place = Sequence[Any]


_QUATERNION = ("turn_w", "turn_x", "turn_y", "turn_z")
_RULES = ("newton_euler", "kinematic_copy", "turn_over_element", "goal_rotation")


@dataclass(frozen=True)
class RigidBody(ABC):
    """A rigid body in the plane or in space: `PlanarBody` and `SpatialBody` say what acts on it beside robots.

    Attributes
    ----------
    shape : PlanarShape or SpatialShape
    mass : float
    inertia : float or (float, float, float)
    """

    shape: Any
    mass: float
    inertia: float | tuple[float, float, float]

    def __post_init__(self) -> None:
        check_positive(self, "mass")
        moments = np.atleast_1d(np.asarray(self.inertia, dtype=float))
        fitting = moments.shape in ((1,), (self._turns,))
        if not fitting or not (np.isfinite(moments) & (moments > 0)).all():
            raise ModelError(
                f"{type(self).__name__}: inertia = {self.inertia!r}; expected a positive number or three, the "
                "principal moments in space."
            )
        if len(moments) == 3 and 2 * moments.max() > moments.sum() * (1 + 1e-9):
            raise ModelError(
                f"{type(self).__name__}: inertia = {self.inertia!r}; no body has a principal moment above the sum of "
                "the others."
            )

    @property
    def _turns(self) -> int:
        """How many entries an angular velocity has."""
        return len(self.shape.names.twist) - len(self.shape.names.axes)

    @property
    def moments(self) -> tuple[float, ...]:
        """The principal moments of inertia: one in the plane, three in space."""
        return tuple(np.broadcast_to(np.asarray(self.inertia, dtype=float), self._turns).tolist())

    @abstractmethod
    def passive_wrench(self, twist: Vector) -> Sequence[Any]:
        """Force and moment on a body with this velocity, beside the wrenches; numbers, arrays or expressions."""

    def angular_acceleration(self, moment: Vector, spin: Vector, rotation: Matrix) -> list[Any]:
        """Euler's equations in the directions of the world: ``R J^-1 (R'm - R'w x J R'w)``.

        Parameters
        ----------
        moment, spin : numbers, arrays or expressions
            Moment on the body, newton metres, and angular velocity, radians per second: one entry or three.
        rotation : rows of a matrix
            Not read in the plane, and where the inertia is the same about every axis.
        """
        moments = self.moments
        if len(set(moments)) == 1:
            return [m / moments[0] for m in moment]
        columns = list(zip(*rotation, strict=True))
        turned = [dot(column, spin) for column in columns]
        gyroscopic = cross_product(turned, [j * w for j, w in zip(moments, turned, strict=True)])
        in_body = [(dot(c, moment) - g) / j for c, g, j in zip(columns, gyroscopic, moments, strict=True)]
        return [dot(row, in_body) for row in rotation]

    def _acceleration(self, pushed: Vector, twist: Vector, orientation: Vector) -> list[Any]:
        """What the body gets of a wrench at a velocity and an orientation, as phases name their entries."""
        axes = len(self.shape.names.axes)
        total = [push + passive for push, passive in zip(pushed, self.passive_wrench(twist), strict=True)]
        rotation = rotation_rows(orientation)
        return [force / self.mass for force in total[:axes]] + self.angular_acceleration(
            total[axes:], twist[axes:], rotation
        )

    def state_wrench(self, phase: Any, *index: Any, as_expressions: bool = False) -> None:
        """Declare a wrench on this body: what one robot does to it. Serves as the rule of an indexed phase.

        Parameters
        ----------
        phase : PhaseBlock
        *index
            Not read; it is there for ``PhaseBlock(names, rule=body.state_wrench)``.
        as_expressions : bool
            Expressions that a contact fills in, in place of variables with a row each.
        """
        for name in self.shape.names.wrench:
            if as_expressions:
                phase.add_component(name, Expression(phase.points, initialize=0.0))
            else:
                phase.declare(name, Control())

    def state_motion(
        self,
        phase: Any,
        wrenches: Iterable[Any],
        *,
        start: Place,
        goal: Place | None = None,
        velocity_at_start: Sequence[float] = (0.0,) * 6,
    ) -> None:
        """State that the body moves under wrenches and what acts on it anyway and, where it has a goal, comes to rest.

        Parameters
        ----------
        phase : PhaseBlock
            Gets the states of pose and velocity and their equations. In space it has to be on the implicit Euler
            scheme, with a duration that is a number, and gets algebraics ``turn_w``, ``turn_x``, ``turn_y``,
            ``turn_z``, the quaternion of the turn over an element.
        wrenches : iterable of PhaseBlock
            Each with a wrench on this body, on the same grid.
        start : (x, y, theta) or (x, y, z, r_x, r_y, r_z)
            Metres, radians; in space with a rotation vector, axis times angle.
        goal : (x, y, theta) or (x, y, z, r_x, r_y, r_z), optional
            Where it comes to rest. An entry is a number, a pair (lower, upper), or None where any value will do; the
            rotation vector is three numbers, or three times None. The initial guess leads there on a straight line
            and by the shortest turn.
        velocity_at_start : (u_x, u_y, w) or (u_x, u_y, u_z, w_x, w_y, w_z)
            Metres and radians per second.

        Raises
        ------
        ModelError
            When a name is taken, a wrench lacks a component, grids differ, or, in space, the phase has a free duration.

        Notes
        -----
        In space the rotation has nine entries and three degrees of freedom: the steps keep it a rotation. Its goal is
        therefore stated by three equations, ``vee(G'R - R'G) = 0``, and ``trace(G'R) >= 2.99``, which leaves out the
        half turns that satisfy these too. Nine equations would be dependent.
        """
        names, wrenches = self.shape.names, list(wrenches)
        for wrench in wrenches:
            check_has(wrench, phase, *names.wrench)
        turn, guesses = self._state_coordinates(phase, start, goal, is_final=True)
        resting = None if goal is None else 0.0
        for name, first, guess in zip(names.twist, velocity_at_start, guesses, strict=False):
            phase.declare(name, State(initial=float(first), final=resting, initial_guess=guess))
        if turn is not None:
            turn.state(phase)

        @phase.ode
        def newton_euler(b: Any, t: float) -> dict[Any, Any]:
            twist = entries_at(b, names.twist, t)
            pushed = [sum(getattr(wrench, name)[t] for wrench in wrenches) for name in names.wrench]
            accelerations = self._acceleration(pushed, twist, entries_at(b, names.orientation, t))
            rates = dict(zip(self._coordinates, twist, strict=False))
            rates |= zip(names.twist, accelerations, strict=True)
            return {getattr(b, name): rate for name, rate in rates.items()}

        if turn is not None and turn.last is not None:
            turn.state_goal(phase, turn.last)

    def state_copy(self, phase: Any, *, start: Place, goal: Place | None = None) -> None:
        """State a kinematic copy: the pose follows velocities that are chosen freely. Where it goes, others decide.

        Parameters
        ----------
        phase : PhaseBlock
            Gets the states of the pose, and the velocities as controls; in space a rotation matrix where the shape is
            not round, because a contact reads it only then.
        start : (x, y, theta) or (x, y, z, r_x, r_y, r_z)
            Metres, radians.
        goal : (x, y, theta) or (x, y, z, r_x, r_y, r_z), optional
            Where the initial guess leads; nothing is required of the end.

        Raises
        ------
        ModelError
            When a name is taken, or, in space, the phase has a free duration.
        """
        turn, guesses = self._state_coordinates(phase, start, goal, is_final=False)
        for name, guess in zip(self.shape.names.twist, guesses, strict=True):
            phase.declare(name, Control(initial_guess=guess))
        if turn is not None and not self.shape.is_round:
            turn.state(phase)

        @phase.ode
        def kinematic_copy(b: Any, t: float) -> dict[Any, Any]:
            followed = zip(self._coordinates, self.shape.names.twist, strict=False)
            return {getattr(b, name): getattr(b, speed)[t] for name, speed in followed}

    @property
    def _coordinates(self) -> tuple[str, ...]:
        """The states whose rates are the first velocities: in space the rotation follows the others by a map."""
        return (*self.shape.names.position, *self.shape.names.orientation)[:3]

    def _state_coordinates(
        self, phase: Any, start: Place, goal: Place | None, is_final: bool
    ) -> tuple[_Turn | None, list[float]]:
        """Declare the pose but for a rotation in space; that, and a guess of all velocities."""
        names = self.shape.names
        check_free(phase, *names.position, *names.orientation, *names.twist, *_QUATERNION, *_RULES)
        for end, pose in (("start", start), ("goal", goal)):
            if pose is not None and len(pose) != len(names.twist):
                angle = "an angle" if self.shape.names is PLANE else "a rotation vector"
                raise ModelError(
                    f"phase '{phase.name}': {end} = {pose!r}; expected {len(names.twist)} entries, a position and "
                    f"{angle}."
                )
        turn = None if names is PLANE else _Turn(phase, start, goal)
        ends = [None] * 3 if goal is None else list(goal)[:3]
        seconds = phase.final_time - phase.initial_time
        share = (np.array(list(phase.time)) - phase.initial_time) / seconds
        speeds = []
        for name, first, last in zip(self._coordinates, start[:3], ends, strict=True):
            way = 0.0 if last is None else float(np.mean(last)) - first
            final = last if is_final else None
            phase.declare(name, State(initial=first, final=final, initial_guess=first + share * way))
            speeds.append(way / seconds)
        return turn, speeds + ([] if turn is None else turn.spin)


@dataclass(frozen=True)
class GroundFriction:
    """Coulomb friction of a body that slides on the ground, smoothed near rest.

    The force is ``-mu m g v / sqrt(|v|^2 + s^2)``, the moment ``-mu m g l^2 w / sqrt((l w)^2 + s^2)``.

    Attributes
    ----------
    coefficient : float
        ``mu``.
    lever : float
        ``l``, mean distance of what touches the ground from the centre, metres.
    slip_speed : float
        ``s``, speed below which friction grows with speed, metres per second.
    gravity : float
        Metres per second squared.
    """

    coefficient: float
    lever: float
    slip_speed: float = 0.05
    gravity: float = 9.81

    def wrench(self, mass: float, u_x: Any, u_y: Any, u_theta: Any) -> tuple[Any, Any, Any]:
        """Force and moment on a body with this mass and velocity; numbers, arrays or expressions."""
        weight = self.coefficient * mass * self.gravity
        sliding = weight / root(u_x**2 + u_y**2 + self.slip_speed**2)
        turning = weight * self.lever**2 / root((self.lever * u_theta) ** 2 + self.slip_speed**2)
        return -sliding * u_x, -sliding * u_y, -turning * u_theta


@dataclass(frozen=True)
class ViscousDrag:
    """Resistance that grows with speed: ``-linear v`` and ``-angular w``.

    Attributes
    ----------
    linear : float
        Newton seconds per metre.
    angular : float
        Newton metre seconds.
    """

    linear: float
    angular: float = 0.0

    def wrench(self, mass: float, u_x: Any, u_y: Any, u_theta: Any) -> tuple[Any, Any, Any]:
        """Force and moment on a body with this velocity; numbers, arrays or expressions."""
        return -self.linear * u_x, -self.linear * u_y, -self.angular * u_theta


@dataclass(frozen=True)
class PlanarBody(RigidBody):
    """A rigid body in the plane.

    On a phase, its pose is ``qx``, ``qy``, ``qth`` (metres, radians) and its velocity ``ux``, ``uy``, ``uth``; a
    wrench on it is ``fx``, ``fy``, ``mz``, force and moment about the origin of its frame, its centre of mass, as means
    over each element (newtons, newton metres), in the directions of the world.

    Attributes
    ----------
    shape : Disc, Capsule or RoundedBox
        Around the centre of mass.
    mass : float
        Kilograms.
    inertia : float
        About the centre of mass, kilogram square metres.
    resistance : GroundFriction, ViscousDrag or None
        What slows it down; any object with a method ``wrench(mass, u_x, u_y, u_theta)``.

    Examples
    --------
    >>> import pyrobocop_pyomo as rcp
    >>> planar = rcp.mechanics.planar
    >>> rod = planar.RigidBody(planar.Capsule(radius=0.05, half_length=0.45), mass=2.0, inertia=2 / 12)
    >>> round(rod.shape.gap_to_disc(0.1, 0.0, 0.35).gap, 3)
    0.2
    """

    shape: PlanarShape
    resistance: GroundFriction | ViscousDrag | None = None

    def passive_wrench(self, twist: Vector) -> Sequence[Any]:
        """Resistance."""
        return (0.0,) * 3 if self.resistance is None else self.resistance.wrench(self.mass, *twist)


@dataclass(frozen=True)
class SpatialBody(RigidBody):
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
    gravity: float = 9.81

    def __post_init__(self) -> None:
        super().__post_init__()
        if not np.isfinite(self.gravity):
            raise ModelError(f"SpatialBody: gravity = {self.gravity!r}; expected a number.")

    def passive_wrench(self, twist: Vector) -> Sequence[Any]:
        """Its weight."""
        return 0.0, 0.0, -self.mass * self.gravity, 0.0, 0.0, 0.0


class _Turn:
    """The rotation of a body in space, which steps by the quaternion of each element's turn; the shortest is the guess.

    Attributes
    ----------
    spin : list of three float
        Constant; with it the rotations of the guess satisfy the steps of the exponential map.
    last : array, shape (3, 3), or None
        Rotation of the goal.
    """

    def __init__(self, phase: Any, start: Place, goal: Place | None) -> None:
        if phase.has_normalised_time:
            raise ModelError(
                f"phase '{phase.name}': a body steps by the exponential map over elements whose durations are numbers. "
                "Give the phase a fixed start, duration and mesh."
            )
        begins = rotation_matrix(start[3:])
        turn = [None] * 3 if goal is None else list(goal)[3:]
        self.last = None if turn == [None] * 3 else rotation_matrix(turn)
        whole = np.zeros(3) if self.last is None else rotation_vector(self.last @ begins.T)
        seconds = phase.final_time - phase.initial_time
        shares = (np.array(list(phase.time)) - phase.initial_time) / seconds
        self._rotations = np.array([rotation_matrix(share * whole) @ begins for share in shares])
        self.spin: list[float] = (whole / seconds).tolist()

    def state(self, phase: Any) -> None:
        """Rotation states and their steps, on a phase that has the angular velocity."""
        entries = self._rotations.reshape(-1, 9).T
        for name, guess in zip(SPACE.orientation, entries, strict=True):
            phase.declare(name, State(initial=float(guess[0]), initial_guess=guess))
        widths = dict(zip(phase.points, phase.grid.mesh.widths.tolist(), strict=True))
        turns = [turn_quaternion([width * w for w in self.spin]) for width in widths.values()]
        for name, guess in zip(_QUATERNION, np.array(turns, dtype=float).T, strict=True):
            phase.declare(name, Algebraic(initial_guess=guess))

        @phase.residual
        def turn_over_element(b: Any, t: float) -> dict[str, Any]:
            formulas = turn_quaternion([widths[t] * w for w in entries_at(b, SPACE.twist[3:], t)])
            return {name: getattr(b, name)[t] == f for name, f in zip(_QUATERNION, formulas, strict=True)}

        @phase.step_map
        def turn(b: Any, t: float, previous: Any) -> dict[Any, Any]:
            before = rotation_rows([getattr(previous, name) for name in SPACE.orientation])
            after = turn_matrix(entries_at(b, _QUATERNION, t), before)
            return {getattr(b, name): entry for name, entry in zip(SPACE.orientation, chain(*after), strict=True)}

    @staticmethod
    def state_goal(phase: Any, goal: Array) -> None:
        """The rotation is the goal's rotation at the end."""
        columns = goal.T.tolist()
        final = phase.final_time

        @phase.constraint_at_boundaries
        def goal_rotation(b: Any, t: float) -> Any:
            if t != final:
                return dict.fromkeys(("x", "y", "z", "trace"), Constraint.Skip)
            rotation = rotation_rows(entries_at(b, SPACE.orientation, t))
            # Row i and column j of G'R: column i of the goal with column j of the rotation.
            reached = [[dot(g, r) for r in zip(*rotation, strict=True)] for g in columns]
            return {
                "x": reached[2][1] - reached[1][2] == 0,
                "y": reached[0][2] - reached[2][0] == 0,
                "z": reached[1][0] - reached[0][1] == 0,
                "trace": reached[0][0] + reached[1][1] + reached[2][2] >= 2.99,
            }


@dataclass(frozen=True)
class DrivenRobot:
    """A double integrator that is driven by a force along each axis of the world.

    Attributes
    ----------
    shape : Disc or Sphere
    mass : float
    force_limit : float or pairs (lowest, highest)
    speed_limit : float
    """

    shape: Any
    mass: float
    force_limit: float | Sequence[tuple[float, float]]
    speed_limit: float
    gravity = 0.0

    def __post_init__(self) -> None:
        check_positive(self, "mass", "speed_limit")
        limits = self.driving_limits
        if limits.shape != (2, len(self.shape.names.axes)) or not (limits[0] <= limits[1]).all():
            raise ModelError(
                f"{type(self).__name__}: force_limit = {self.force_limit!r}; expected a positive number, or a pair "
                "(lowest, highest) for each axis."
            )

    @property
    def driving_limits(self) -> Array:
        """Lowest and highest driving force along each axis, newtons; shape (2, d)."""
        limits = np.asarray(self.force_limit, dtype=float)
        if limits.ndim == 0:
            limits = np.tile((-limits, limits), (len(self.shape.names.axes), 1))
        return limits.T

    @property
    def falling(self) -> Array:
        """Acceleration by gravity along each axis, metres per second squared; shape (d,)."""
        falling = np.zeros(len(self.shape.names.axes))
        falling[-1] = -self.gravity
        return falling

    @property
    def hovering_force(self) -> Array:
        """The driving force that carries its weight, newtons; shape (d,)."""
        force: Array = 0.0 - self.mass * self.falling
        return force

    def state_motion(
        self,
        phase: Any,
        push: Any,
        *,
        start: Sequence[float],
        within: Sequence[tuple[float | None, float | None]] | None = None,
        rest_at_end: bool = True,
    ) -> None:
        """State that the robot moves from rest under its driving force, gravity, and the reaction to its push.

        Parameters
        ----------
        phase : PhaseBlock
            Gets states, controls and equations.
        push : PhaseBlock
            The wrench of this robot on the body, on the same grid.
        start : sequence of float
            Along each axis, metres.
        within : sequence of (lowest, highest), optional
            Where its centre has to stay along each axis, metres.
        rest_at_end : bool
            Whether it ends at rest.

        Raises
        ------
        ModelError
            When a name is taken, the push lacks a component, the grids differ, or it starts outside of where it has
            to stay.
        """
        axes = self.shape.names.axes
        velocity, force = [f"v{axis}" for axis in axes], [f"tau_{axis}" for axis in axes]
        check_free(phase, *axes, *velocity, *force, "double_integrator")
        check_has(push, phase, *self.shape.names.wrench)
        boxes = [(None, None)] * len(axes) if within is None else within
        for name, place, (low, high) in zip(axes, start, boxes, strict=True):
            phase.declare(name, State(initial=float(place), bounds=(low, high), initial_guess=float(place)))
        for name in velocity:
            limits = (-self.speed_limit, self.speed_limit)
            phase.declare(name, State(initial=0.0, final=0.0 if rest_at_end else None, bounds=limits))
        for name, low, high, hovering in zip(force, *self.driving_limits.tolist(), self.hovering_force, strict=True):
            phase.declare(name, Control(bounds=(low, high), initial_guess=float(hovering)))

        @phase.ode
        def double_integrator(b: Any, t: float) -> dict[Any, Any]:
            rates = {getattr(b, axis): getattr(b, speed)[t] for axis, speed in zip(axes, velocity, strict=True)}
            pushed = [f"f{axis}" for axis in axes]
            for speed, driving, reaction, g in zip(velocity, force, pushed, self.falling.tolist(), strict=True):
                rate = (getattr(b, driving)[t] - getattr(push, reaction)[t]) / self.mass
                rates[getattr(b, speed)] = rate + g if g else rate
            return rates


@dataclass(frozen=True)
class DiscRobot(DrivenRobot):
    """A robot that is a disc and is driven by a force: a double integrator in the plane.

    On a phase, its position is ``x``, ``y``, its velocity ``vx``, ``vy``, its driving force ``tau_x``, ``tau_y``.

    Attributes
    ----------
    shape : Disc
    mass : float
        Kilograms.
    force_limit : float or two pairs (lowest, highest)
        Largest driving force along each axis, or both limits of it, newtons.
    speed_limit : float
        Largest velocity along each axis, metres per second.
    """

    shape: Disc


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
    force_limit : float or three pairs (lowest, highest)
        Largest driving force along each axis, or both limits of it, newtons.
    speed_limit : float
        Largest velocity along each axis, metres per second.
    gravity : float
        Metres per second squared, against the world's z axis.
    """

    shape: Sphere
    gravity: float = 9.81


_OVERLAP = 0.01  # metres: what a start may be measured to be inside a body


def check_positive(thing: Any, *names: str) -> None:
    """Refuse quantities that are not positive and finite numbers."""
    for name in names:
        value = getattr(thing, name)
        if not (np.isfinite(value) and value > 0):
            raise ModelError(f"{type(thing).__name__}: {name} = {value!r}; expected a positive number.")


def check_free(phase: Any, *names: str) -> None:
    """Refuse a phase on which a name that is about to be stated is taken, before anything is added to it."""
    taken = [name for name in names if hasattr(phase, name)]
    if taken:
        raise ModelError(
            f"phase '{phase.name}': '{taken[0]}' is there already. State a motion, a copy or a contact once, each on a "
            "phase that has not its names."
        )


def entries_at(phase: Any, names: Sequence[str], t: float) -> list[Any]:
    """What a phase has under several names at a time index."""
    return [getattr(phase, name)[t] for name in names]


class PhaseNumbers:
    """The values that stand on a phase: ``numbers.x[t]`` is a number where ``phase.x[t]`` is a variable.

    Formulas that were written for a phase give numbers with it, far faster than expressions are evaluated.

    Parameters
    ----------
    phase : PhaseBlock
    """

    def __init__(self, phase: Any) -> None:
        self._phase = phase

    def __getattr__(self, name: str) -> dict[Any, float]:
        numbers = {t: value(entry) for t, entry in getattr(self._phase, name).items()}
        setattr(self, name, numbers)
        return numbers


def check_no_overlap(phase: Any, body: Any, names: Sequence[str], gap: Any) -> None:
    """Refuse a robot that starts inside a body, where the model fixes both."""
    start = phase.time.first()
    own = {name: getattr(phase, name)[start] for name in "xyz" if hasattr(phase, name)}
    if not all(entry.fixed for entry in [*own.values(), *entries_at(body, names, start)]):
        return
    distance = float(gap(PhaseNumbers(phase), PhaseNumbers(body), start).gap)
    if distance < -_OVERLAP:
        place = ", ".join(f"{value(entry):.3g}" for entry in own.values())
        raise ModelError(
            f"phase '{phase.name}': the robot starts at ({place}), {-distance:.3g} m inside the body of phase "
            f"'{body.name}'. Contact cannot undo that: move one of them."
        )


def check_has(phase: Any, beside: Any, *names: str) -> None:
    """Refuse a phase that lacks a component, or whose grid differs from the grid of the phase beside it."""
    missing = [name for name in names if phase.component(name) is None]
    if missing:
        raise ModelError(
            f"phase '{beside.name}' is to read '{missing[0]}' of phase '{phase.name}', which does not have it. State "
            "the wrench, the motion or the copy there first."
        )
    if tuple(phase.points) != tuple(beside.points):
        raise ModelError(
            f"phases '{beside.name}' and '{phase.name}' have different grids, {len(beside.points)} and "
            f"{len(phase.points)} collocation points or other times. Give both the same duration, elements and scheme."
        )
