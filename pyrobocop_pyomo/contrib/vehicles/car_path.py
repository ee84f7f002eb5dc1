"""`CarPath`: a path of arcs, its timing, and the initial guess of a phase that it gives."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.contrib.robots.sampled_path import FINE, functions_of_time_index
from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.modeling.variable_values import within_bounds
from pyrobocop_pyomo.numerics import Array, Indices
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.presentation import Presented

from .car_kinematics import Trailer, follow_arc

Function = Callable[[float], float]

QUANTITIES = ("x", "y", "theta", "v", "steering", "acceleration", "steering_rate")
# Share of the duration over which a jump of the steering is spread where a rate is requested.
BLEND = 0.05


@dataclass(frozen=True, eq=False)
class CarPath(Presented):
    """Poses of a car from its start to its goal; between two of them it follows an arc with constant steering.

    Attributes
    ----------
    poses : (k, 3) array
        x, y and heading of the middle of the rear axle. Headings are continuous: the last may differ from the goal's
        by whole turns. With a trailer ``(k, 4)``: its heading less the car's heading is the last one.
    directions : (k,) array
        1 forwards, -1 backwards, from each pose on; the last value belongs to the last arc.
    steering : (k,) array
        Steering angle from each pose on, positive to the left.
    trailer : Trailer or None
    """

    poses: Array
    directions: Array
    steering: Array
    trailer: Trailer | None = None

    def __post_init__(self) -> None:
        for array in (self.poses, self.directions, self.steering):
            array.setflags(write=False)

    @cached_property
    def arc_lengths(self) -> Array:
        """How far the car has driven at each pose, ``(k,)``."""
        chords = np.hypot(*np.diff(self.poses[:, :2], axis=0).T)
        half = 0.5 * np.diff(self.poses[:, 2])
        return np.concatenate([[0.0], np.cumsum(chords / np.sinc(half / np.pi))])

    @property
    def length(self) -> float:
        """How far the car drives."""
        return float(self.arc_lengths[-1])

    @property
    def cusps(self) -> int:
        """How often it changes its direction."""
        return int(np.count_nonzero(np.diff(self.directions[:-1])))

    def timed(self, speed: float = 1.0, acceleration: float | None = None) -> CarTiming:
        """Timing along the path, with a stop at both ends and at every cusp.

        Parameters
        ----------
        speed : float
            Never exceeded.
        acceleration : float, optional
            While speeding up and slowing down; None: such that the car keeps its speed along two thirds of the
            longest leg between stops.

        Raises
        ------
        InitialGuessError
            When they are not positive.
        """
        turns = np.flatnonzero(np.diff(self.directions[:-1])) + 1
        return CarTiming.over_legs(
            self.arc_lengths[[0, *turns, -1]], self.directions[[0, *turns]], float(speed), acceleration
        )

    def initial_guess(
        self,
        phase: Any,
        *,
        speed: float = 1.0,
        acceleration: float | None = None,
        names: Mapping[str, str] | None = None,
    ) -> dict[str, Function | float]:
        """The path as an initial guess for ``phase.initialize``; the speed vanishes at ends and cusps.

        A free duration gets the one of `timed`, moved into its bounds. Where the duration differs from it, speeds and
        accelerations are scaled.

        Parameters
        ----------
        phase : PhaseBlock
        speed, acceleration : float
            As for `timed`.
        names : dict of str to str, optional
            What the phase calls each of ``x``, ``y``, ``theta``, ``v`` (negative backwards), ``steering``,
            ``acceleration`` and ``steering_rate``, as far as it has them; by default the same. Where a rate is given
            for, jumps of the steering are spread over a twentieth of the duration.

        Returns
        -------
        dict of str to function of the time index, or number

        Raises
        ------
        InitialGuessError
            When names do not fit, and when the heading is fixed at the end whole turns away from the path's heading.
        """
        known = _names(phase, names)
        moments, poses, steering, velocities, accelerations, duration = self.over_phase(
            phase, self.timed(speed, acceleration)
        )
        if "steering_rate" in known:
            window = 2 * int(0.5 * BLEND * FINE) + 1
            steering = np.asarray(scipy.ndimage.uniform_filter1d(steering, window, mode="nearest"))
        of_path = {
            "x": poses[:, 0],
            "y": poses[:, 1],
            "theta": poses[:, 2] + _whole_turns(self, phase, known.get("theta")),
            "v": velocities,
            "steering": steering,
            "acceleration": accelerations,
            "steering_rate": np.gradient(steering, moments),
        }
        return functions_of_time_index(phase, {name: of_path[quantity] for quantity, name in known.items()}) | duration

    def over_phase(self, phase: Any, timing: CarTiming) -> tuple[Array, Array, Array, Array, Array, dict[str, Any]]:
        """The path over the duration of a phase; a free duration becomes the timing's, moved into its bounds.

        Returns
        -------
        times, poses, steering, velocities, accelerations : arrays
            At moments that are evenly spaced.
        duration : dict
            Its guess, where it is free.
        """
        free = phase.component("duration")
        is_free = free is not None and free.ctype is Var and not free.fixed
        duration = within_bounds(timing.duration, free) if is_free else float(value(phase.duration))
        faster = timing.duration / duration
        times = np.linspace(0.0, timing.duration, FINE + 1)
        lengths = timing.arc_length_at(times)
        velocities, accelerations = faster * timing.velocity_at(times), faster**2 * timing.acceleration_at(times)
        steering, guess = self.steering[self.arc_at(lengths)], {"duration": duration} if is_free else {}
        return times / faster, self.poses_at(lengths), steering, velocities, accelerations, guess

    def arc_at(self, distances: ArrayLike) -> Indices:
        """Number of the arc on which the car is after driving so far."""
        return np.clip(np.searchsorted(self.arc_lengths, distances, side="right") - 1, 0, len(self.poses) - 2)

    def poses_at(self, distances: ArrayLike) -> Array:
        """Poses after driving so far, exact on the arcs: ``(n, 3)`` from ``(n,)``, or ``(n, 4)``."""
        driven = np.clip(np.asarray(distances, dtype=float), 0.0, self.length)
        i = self.arc_at(driven)
        lengths = np.diff(self.arc_lengths)
        on_arc = self.directions[i] * (driven - self.arc_lengths[i])
        curvatures = self.directions[:-1] * np.diff(self.poses[:, 2]) / np.where(lengths > 0, lengths, 1.0)
        return follow_arc(self.poses[i], on_arc, curvatures[i], self.trailer)

    def __str__(self) -> str:
        return f"path of a car: length {self.length:.4g}, {self.cusps} cusp{'' if self.cusps == 1 else 's'}"


@dataclass(frozen=True, eq=False)
class CarTiming(Presented):
    """How far a car has driven over time: it stops at ends and cusps, and its acceleration is piecewise constant.

    Attributes
    ----------
    times, arc_lengths, speeds : (m,) arrays
        Where the acceleration jumps; the arc length is how far the car has driven. Speeds are not negative.
    accelerations, directions : (m - 1,) arrays
        From each moment to the next; 1 forwards, -1 backwards.
    """

    times: Array
    arc_lengths: Array
    speeds: Array
    accelerations: Array
    directions: Array

    @classmethod
    def over_legs(cls, legs: Array, directions: Array, speed: float, acceleration: float | None = None) -> CarTiming:
        """Timing of legs, each from rest to rest.

        Parameters
        ----------
        legs : (n + 1,) array
            How far the car has driven where it stops, the start and the goal included.
        directions : (n,) array
        speed : float
            Never exceeded; short legs do not reach it.
        acceleration : float, optional
            While speeding up and slowing down; None: such that the car keeps its speed along two thirds of the
            longest leg.

        Raises
        ------
        InitialGuessError
            When they are not positive.
        """
        lengths = np.diff(legs)
        most = 3.0 * speed**2 / float(lengths.max()) if acceleration is None else acceleration
        for name, number in (("speed", speed), ("acceleration", most)):
            if not (math.isfinite(number) and number > 0.0):
                raise InitialGuessError(f"path of a car: {name} = {number}; expected a positive number.")
        peaks = np.minimum(speed, np.sqrt(most * lengths))
        ramps = peaks / most
        spans = np.column_stack([ramps, np.maximum(lengths / peaks - ramps, 0.0), ramps])
        changes = np.tile([most, 0.0, -most], len(lengths))
        times = np.concatenate([[0.0], np.cumsum(spans.ravel())])
        # Each leg goes from rest to rest. A running sum over the legs would carry its rounding along.
        speeds = np.append(np.column_stack([np.zeros_like(peaks), peaks, peaks]).ravel(), 0.0)
        ramped = 0.5 * peaks * ramps
        arc_lengths = np.append(
            (legs[:-1, None] + np.column_stack([0.0 * ramped, ramped, lengths - ramped])).ravel(), legs[-1]
        )
        return cls(times, arc_lengths, speeds, changes, np.repeat(directions, 3))

    @property
    def duration(self) -> float:
        """When the goal is reached."""
        return float(self.times[-1])

    def arc_length_at(self, t: ArrayLike) -> Array:
        """How far the car has driven."""
        i, past = self._since(t)
        return np.asarray(self.arc_lengths[i] + past * (self.speeds[i] + 0.5 * past * self.accelerations[i]))

    def velocity_at(self, t: ArrayLike) -> Array:
        """Along the heading: negative while the car drives backwards."""
        i, past = self._since(t)
        return np.asarray(self.directions[i] * (self.speeds[i] + past * self.accelerations[i]))

    def acceleration_at(self, t: ArrayLike) -> Array:
        """Rate of the velocity."""
        i, _ = self._since(t)
        return np.asarray(self.directions[i] * self.accelerations[i])

    def _since(self, t: ArrayLike) -> tuple[Indices, Array]:
        times = np.clip(np.asarray(t, dtype=float), 0.0, self.duration)
        i = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.accelerations) - 1)
        return i, times - self.times[i]

    def _summary(self) -> str:
        return f"{len(self.times)} times, {self.times[-1]:.4g} s, length {self.arc_lengths[-1]:.4g}"


def _names(phase: Any, names: Mapping[str, str] | None) -> dict[str, str]:
    if names is None:
        quantities = {quantity: quantity for quantity in QUANTITIES if phase.component(quantity) is not None}
        if not quantities:
            raise InitialGuessError(
                f"phase '{phase.name}' has none of {', '.join(QUANTITIES)}. Say what it calls them: "
                "names={'x': 'position_x', ...}."
            )
        return quantities
    for quantity, name in names.items():
        if quantity not in QUANTITIES:
            raise InitialGuessError(
                f"names: '{quantity}' is not known of a car's path; known are {', '.join(QUANTITIES)}."
            )
        if phase.component(name) is None:
            raise InitialGuessError(f"names: '{quantity}' is to be '{name}', which phase '{phase.name}' does not have.")
    return dict(names)


def _whole_turns(path: CarPath, phase: Any, name: str | None) -> float:
    """What to add to all headings so that the first one agrees with the phase.

    Raises
    ------
    InitialGuessError
        When the last heading then differs from a fixed one by whole turns: no model gets there by this path.
    """
    if name is None:
        return 0.0
    heading = phase.component(name)
    first, last = heading[phase.time.first()], heading[phase.time.last()]
    full = 2.0 * math.pi
    turned = full * round((first.value - path.poses[0, 2]) / full) if first.fixed and first.value is not None else 0.0
    end = float(path.poses[-1, 2]) + turned
    if last.fixed and last.value is not None and round((last.value - end) / full) != 0:
        raise InitialGuessError(
            f"phase '{phase.name}': this path ends with the heading {end:.6g}, and '{name}' is fixed at "
            f"{last.value:.6g} there, {abs(round((last.value - end) / full))} whole turn(s) away. State "
            f"final={end:.6g} for '{name}', or add whole turns to its initial value."
        )
    return turned
