"""`CarPath`: where a car rolls, arc by arc, and how it serves as a guess."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .car_guess import Function, car_guess
from .car_timing import CarTiming
from .rolling import rolled

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CarPath:
    """Poses of a car from its start to its goal; between two of them it rolls along an arc with its steering held.

    Attributes
    ----------
    poses : (k, 3) array
        x, y and heading of the middle of the rear axle. Headings are continuous: the last may differ from the goal's
        by whole turns.
    directions : (k,) array
        1 forwards, -1 backwards, from each pose on; the last value is that of the last arc.
    steering : (k,) array
        Steering angle from each pose on, positive to the left.
    """

    poses: Array
    directions: Array
    steering: Array

    def __post_init__(self) -> None:
        for each in (self.poses, self.directions, self.steering):
            each.setflags(write=False)

    @cached_property
    def ways(self) -> Array:
        """How far the car has rolled at each pose, ``(k,)``."""
        chords = np.hypot(*np.diff(self.poses[:, :2], axis=0).T)
        half = 0.5 * np.diff(self.poses[:, 2])
        return np.concatenate([[0.0], np.cumsum(chords / np.sinc(half / np.pi))])

    @property
    def length(self) -> float:
        """How far the car rolls."""
        return float(self.ways[-1])

    @property
    def cusps(self) -> int:
        """How often it changes its direction."""
        return int(np.count_nonzero(np.diff(self.directions[:-1])))

    def timed(self, speed: float = 1.0, acceleration: float | None = None) -> CarTiming:
        """When the car is where: it stops at both ends and at every cusp.

        Parameters
        ----------
        speed : float
            Never exceeded.
        acceleration : float, optional
            While speeding up and slowing down; None: such that the car keeps its speed along two thirds of the
            longest leg between stops.

        Raises
        ------
        GuessError
            When they are not positive.
        """
        turns = np.flatnonzero(np.diff(self.directions[:-1])) + 1
        return CarTiming.over_legs(self.ways[[0, *turns, -1]], self.directions[[0, *turns]], float(speed), acceleration)

    def guess(
        self,
        phase: Any,
        *,
        speed: float = 1.0,
        acceleration: float | None = None,
        names: Mapping[str, str] | None = None,
    ) -> dict[str, Function | float]:
        """The path as a guess for ``phase.set_guess``: along it at a speed that vanishes at ends and cusps.

        A free duration gets that of `timed`, moved into its bounds; where the duration is another one, speeds and
        accelerations are scaled to it.

        Parameters
        ----------
        phase : PhaseBlock
        speed, acceleration : float
            As for `timed`.
        names : dict of str to str, optional
            What the phase calls each of ``x``, ``y``, ``theta``, ``v`` (negative backwards), ``steering``,
            ``acceleration`` and ``steering_rate``, as far as it has them; by default the same. Where a rate is asked
            for, jumps of the steering are spread over a twentieth of the duration.

        Returns
        -------
        dict of str to function of the time index, or number

        Raises
        ------
        GuessError
            When names do not fit, and when the heading is fixed at the end whole turns away from that of the path.
        """
        return car_guess(self, phase, speed, acceleration, names)

    def piece_at(self, ways: ArrayLike) -> NDArray[np.int64]:
        """Number of the arc on which the car is after rolling so far."""
        return np.clip(np.searchsorted(self.ways, ways, side="right") - 1, 0, len(self.poses) - 2)

    def at(self, ways: ArrayLike) -> Array:
        """Poses after rolling so far, exact on the arcs: ``(n, 3)`` from ``(n,)``."""
        far = np.clip(np.asarray(ways, dtype=float), 0.0, self.length)
        i = self.piece_at(far)
        lengths = np.diff(self.ways)
        rolled_here = self.directions[i] * (far - self.ways[i])
        curvatures = self.directions[:-1] * np.diff(self.poses[:, 2]) / np.where(lengths > 0, lengths, 1.0)
        return rolled(self.poses[i], rolled_here, curvatures[i])

    def __str__(self) -> str:
        return f"path of a car: length {self.length:.4g}, {self.cusps} cusp{'' if self.cusps == 1 else 's'}"
