"""When a car is where on its path: it stops at both ends and at every cusp, and speeds up evenly in between."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyrobocop_pyomo.errors import GuessError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CarTiming:
    """How far a car has rolled over time; its acceleration is piecewise constant.

    Attributes
    ----------
    times, ways, speeds : (m,) arrays
        At the moments when the acceleration jumps. Speeds are not negative.
    accelerations, directions : (m - 1,) arrays
        From each moment to the next; 1 forwards, -1 backwards.
    """

    times: Array
    ways: Array
    speeds: Array
    accelerations: Array
    directions: Array

    @classmethod
    def over_legs(cls, legs: Array, directions: Array, speed: float, acceleration: float | None = None) -> CarTiming:
        """Timing of legs, each from rest to rest.

        Parameters
        ----------
        legs : (n + 1,) array
            How far the car has rolled where it stops, the start and the goal included.
        directions : (n,) array
        speed : float
            Never exceeded; short legs do not reach it.
        acceleration : float, optional
            While speeding up and slowing down; None: such that the car keeps its speed along two thirds of the
            longest leg.

        Raises
        ------
        GuessError
            When they are not positive.
        """
        lengths = np.diff(legs)
        most = 3.0 * speed**2 / float(lengths.max()) if acceleration is None else acceleration
        for name, number in (("speed", speed), ("acceleration", most)):
            if not (math.isfinite(number) and number > 0.0):
                raise GuessError(f"path of a car: {name} = {number}; expected a positive number.")
        peaks = np.minimum(speed, np.sqrt(most * lengths))
        ramps = peaks / most
        spans = np.column_stack([ramps, np.maximum(lengths / peaks - ramps, 0.0), ramps])
        changes = np.tile([most, 0.0, -most], len(lengths))
        times = np.concatenate([[0.0], np.cumsum(spans.ravel())])
        # From rest to rest each: a running sum over the legs would carry its rounding along.
        speeds = np.append(np.column_stack([np.zeros_like(peaks), peaks, peaks]).ravel(), 0.0)
        ramped = 0.5 * peaks * ramps
        ways = np.append(
            (legs[:-1, None] + np.column_stack([0.0 * ramped, ramped, lengths - ramped])).ravel(), legs[-1]
        )
        return cls(times, ways, speeds, changes, np.repeat(directions, 3))

    @property
    def duration(self) -> float:
        """When the goal is reached."""
        return float(self.times[-1])

    def way_at(self, t: ArrayLike) -> Array:
        """How far the car has rolled."""
        i, past = self._since(t)
        return np.asarray(self.ways[i] + past * (self.speeds[i] + 0.5 * past * self.accelerations[i]))

    def velocity_at(self, t: ArrayLike) -> Array:
        """Along the heading: negative while the car rolls backwards."""
        i, past = self._since(t)
        return np.asarray(self.directions[i] * (self.speeds[i] + past * self.accelerations[i]))

    def acceleration_at(self, t: ArrayLike) -> Array:
        """Rate of the velocity."""
        i, _ = self._since(t)
        return np.asarray(self.directions[i] * self.accelerations[i])

    def _since(self, t: ArrayLike) -> tuple[NDArray[np.int64], Array]:
        times = np.clip(np.asarray(t, dtype=float), 0.0, self.duration)
        i = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.accelerations) - 1)
        return i, times - self.times[i]
