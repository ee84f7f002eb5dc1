"""Bodies and disc robots that move in the plane: what a phase states of their motion.

On the implicit Euler scheme the equations are the impulse form of mechanics: momentum at the end of an element is
momentum at its start plus the impulse of the mean forces, and positions move with the velocities at its end.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from pyomo.core.base.expression import Expression
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases import Control, State

from .planar_shapes import Disc, PlanarShape
from .shapes import root

Place = Sequence[Any]

POSE = ("qx", "qy", "qth")
TWIST = ("ux", "uy", "uth")
WRENCH = ("fx", "fy", "mz")


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


class PushedBody:
    """A body on which others exert wrenches."""

    _WRENCH: ClassVar[tuple[str, ...]]

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
        for name in self._WRENCH:
            if as_expressions:
                phase.add_component(name, Expression(phase.points, initialize=0.0))
            else:
                phase.declare(name, Control())


@dataclass(frozen=True)
class PlanarBody(PushedBody):
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
    mass: float
    inertia: float
    resistance: GroundFriction | ViscousDrag | None = None

    _WRENCH = WRENCH

    def __post_init__(self) -> None:
        check_positive(self, "mass", "inertia")

    def state_motion(self, phase: Any, wrenches: Iterable[Any], *, start: Place, goal: Place | None = None) -> None:
        """State that the body moves under wrenches, from rest and, where it has a goal, to rest.

        Parameters
        ----------
        phase : PhaseBlock
            Gets the states of pose and velocity and their equations.
        wrenches : iterable of PhaseBlock
            Each with ``fx``, ``fy``, ``mz`` on the same grid.
        start : (x, y, theta)
            Metres, radians.
        goal : (x, y, theta), optional
            Where it comes to rest. An entry is a number, a pair (lower, upper), or None where any value will do. The
            initial guess is a straight line to it.

        Raises
        ------
        ModelError
            When a name is taken, a wrench lacks a component, or the grids differ.
        """
        wrenches = list(wrenches)
        check_free(phase, *POSE, *TWIST, "newton_euler")
        for wrench in wrenches:
            check_has(wrench, phase, *WRENCH)
        lines, speeds = _straight(phase, start, goal)
        for name, first, last, guess in zip(POSE, *_ends(start, goal), lines, strict=True):
            phase.declare(name, State(initial=first, final=last, initial_guess=guess))
        for name, speed in zip(TWIST, speeds, strict=True):
            phase.declare(name, State(initial=0.0, final=None if goal is None else 0.0, initial_guess=speed))

        @phase.ode
        def newton_euler(b: Any, t: float) -> dict[Any, Any]:
            u = b.ux[t], b.uy[t], b.uth[t]
            forces = [sum(getattr(wrench, name)[t] for wrench in wrenches) for name in WRENCH]
            if self.resistance is not None:
                forces = [a + r for a, r in zip(forces, self.resistance.wrench(self.mass, *u), strict=True)]
            rates = dict(zip((b.qx, b.qy, b.qth), u, strict=True))
            inertia = (self.mass, self.mass, self.inertia)
            return rates | {getattr(b, n): f / i for n, f, i in zip(TWIST, forces, inertia, strict=True)}

    def state_copy(self, phase: Any, *, start: Place, goal: Place | None = None) -> None:
        """State a kinematic copy: the pose follows a velocity that is chosen freely. Where it goes, others decide.

        Parameters
        ----------
        phase : PhaseBlock
            Gets the states of the pose, and the velocity as controls.
        start : (x, y, theta)
            Metres, radians.
        goal : (x, y, theta), optional
            Where the straight line of the initial guess ends; nothing is required of the end.

        Raises
        ------
        ModelError
            When a name is taken.
        """
        check_free(phase, *POSE, *TWIST, "kinematic_copy")
        lines, speeds = _straight(phase, start, goal)
        for name, first, guess in zip(POSE, start, lines, strict=True):
            phase.declare(name, State(initial=first, initial_guess=guess))
        for name, speed in zip(TWIST, speeds, strict=True):
            phase.declare(name, Control(initial_guess=speed))

        @phase.ode
        def kinematic_copy(b: Any, t: float) -> dict[Any, Any]:
            return {b.qx: b.ux[t], b.qy: b.uy[t], b.qth: b.uth[t]}


class DrivenRobot(ABC):
    """A double integrator that is driven by a force along each axis of the world."""

    mass: float
    speed_limit: float

    _AXES: ClassVar[tuple[str, ...]]
    _WRENCH: ClassVar[tuple[str, ...]]

    @property
    @abstractmethod
    def driving_limits(self) -> Array:
        """Lowest and highest driving force along each axis, newtons; shape (2, d)."""

    @property
    def falling(self) -> Array:
        """Acceleration by gravity along each axis, metres per second squared; shape (d,)."""
        return np.zeros(len(self._AXES))

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
        axes = self._AXES
        velocity, force = [f"v{axis}" for axis in axes], [f"tau_{axis}" for axis in axes]
        check_free(phase, *axes, *velocity, *force, "double_integrator")
        check_has(push, phase, *self._WRENCH)
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
    force_limit : float
        Largest driving force along each axis, newtons.
    speed_limit : float
        Largest velocity along each axis, metres per second.
    """

    shape: Disc
    mass: float
    force_limit: float
    speed_limit: float

    _AXES = ("x", "y")
    _WRENCH = WRENCH

    def __post_init__(self) -> None:
        check_positive(self, "mass", "force_limit", "speed_limit")

    @property
    def driving_limits(self) -> Array:
        """Lowest and highest driving force along each axis, newtons."""
        return np.outer((-self.force_limit, self.force_limit), np.ones(2))


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
    """Refuse a phase that lacks a component, or whose grid is not that of the phase beside it."""
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


def _ends(start: Place, goal: Place | None) -> tuple[list[Any], list[Any]]:
    return list(start), [None] * len(start) if goal is None else list(goal)


def middle_of_goal(first: float, last: Any) -> float:
    """Where the initial guess ends."""
    if last is None:
        return first
    return float(np.mean(last)) if isinstance(last, tuple) else float(last)


def _straight(phase: Any, start: Place, goal: Place | None) -> tuple[list[Array], list[float]]:
    """Entries of the pose on a straight line to the goal, at the times of the phase, and their speeds."""
    seconds = phase.final_time - phase.initial_time
    share = (np.array(list(phase.time)) - phase.initial_time) / seconds
    ways = [(first, middle_of_goal(first, last) - first) for first, last in zip(*_ends(start, goal), strict=True)]
    return [first + share * way for first, way in ways], [way / seconds for _, way in ways]
