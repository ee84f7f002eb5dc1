"""Stretches of motion that one certificate covers."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose
from pyrobocop_pyomo.motion.motion import Motion

PlaneIndex = tuple[str, str, Hashable]


@dataclass(frozen=True)
class Piece:
    """The stretch of motion that one certificate covers: an interval, a part of one, or a single time.

    Attributes
    ----------
    first, second : str
        Names of the parts that are kept apart.
    interval : int or None
        Position of the interval; None where the certificate is for one time.
    times : tuple
        Time indices at which the poses are asked, start and end included.
    fractions : tuple of float
        Where these lie within the interval, from 0 to 1; empty where the certificate is for one time.
    """

    first: str
    second: str
    interval: int | None
    times: tuple[Any, ...]
    fractions: tuple[float, ...] = ()

    @property
    def index(self) -> PlaneIndex:
        """Index of the certificate in all components."""
        return (self.first, self.second, self.times[0])

    def pose_at(self, motion: Motion, rule: Callable[..., Any], position: int, body: str) -> Pose:
        """Expressions of the pose at one of the times."""
        if self.interval is None:
            return motion.pose_at_node(rule, self.times[position], name=body)
        return motion.pose_at(rule, self.interval, self.fractions[position], name=body)


def pieces_of_motion(what: str, pairs: list[tuple[str, str]], motion: Motion, per_interval: bool) -> list[Piece]:
    """The pieces of an unrefined motion: an interval each, or a point each.

    Raises
    ------
    ObstacleError
        When there are no intervals, or the points are not numbers or names.
    """
    if not per_interval:
        for time in motion.points:
            if isinstance(time, tuple):
                raise ObstacleError(f"{what}: the points are tuples such as {time}; give a set of single indices.")
        return [Piece(*pair, None, (time,)) for pair in pairs for time in motion.points]
    if not motion.intervals:
        raise ObstacleError(
            f"{what}: one plane per interval was asked for, but nothing is known about the motion between the points "
            "given. Give the times of a phase, a discretised ContinuousSet or ordered numbers; or between=None, which "
            "looks at the points only."
        )
    intervals = [(k, times, motion.local_fractions(k)) for k, times in enumerate(motion.intervals)]
    return [Piece(*pair, k, times, fractions) for pair in pairs for k, times, fractions in intervals]


def halves(motion: Motion, piece: Piece) -> tuple[Piece, Piece]:
    """The two halves of a piece; they share the time between, which becomes a time of its own if it was none."""
    assert piece.interval is not None
    middle = (piece.fractions[0] + piece.fractions[-1]) / 2
    at = dict(zip(piece.fractions, piece.times, strict=True))
    at.setdefault(middle, motion.index_at(piece.interval, middle))
    fractions = sorted(at)
    cuts = [f for f in fractions if f <= middle], [f for f in fractions if f >= middle]
    left, right = (
        Piece(piece.first, piece.second, piece.interval, tuple(at[f] for f in cut), tuple(cut)) for cut in cuts
    )
    return left, right
