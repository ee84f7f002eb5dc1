"""`SafetyReport`: the distances that are proven for all body pairs, at all times."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pyrobocop_pyomo.numerics import Array


@dataclass(frozen=True, eq=False)
class BodyPairSafety:
    """The result for one pair of convex parts of two bodies.

    Attributes
    ----------
    first, second : str
        Names of the parts.
    clearance, tolerance : float
        The distance asked for is ``clearance``; one that is proven to ``clearance - tolerance`` counts as kept.
    distance : float
        Smallest signed distance of all instants measured; a search measures the intervals that are proven least.
        Negative: the parts overlap.
    proven : float
        The signed distance is at least this at all times.
    time : float
        When `distance` was found; for a set without order, the point.
    interval : int or None
        Where `distance` was found; None for points without order.
    interval_distance, interval_proven : array, shape (intervals,)
        `distance` and `proven` of each interval, or of each point where there are no intervals. NaN in
        `interval_distance`: the interval was proven clear by boxes, and no instant of it was measured.
    undecided : tuple of int
        Intervals that are neither proven clear nor found violated. Among them are intervals in which a body jumps at a
        node or is distorted between nodes by more than the tolerance, as values that are not a solution may have it.
    subintervals : int
        Number of subintervals that the proof used.
    """

    first: str
    second: str
    clearance: float
    tolerance: float
    distance: float
    proven: float
    time: Any
    interval: int | None
    interval_distance: Array = field(repr=False)
    interval_proven: Array = field(repr=False)
    undecided: tuple[int, ...]
    subintervals: int

    @property
    def safe(self) -> bool:
        """Whether the clearance, less the tolerance, is proven at all times."""
        return bool(self.proven >= self.clearance - self.tolerance)

    @property
    def unproven(self) -> tuple[int, ...]:
        """Intervals (or points) for which the clearance, less the tolerance, is not proven."""
        return tuple(np.flatnonzero(self.interval_proven < self.clearance - self.tolerance).tolist())

    @property
    def violated(self) -> tuple[int, ...]:
        """Intervals (or points) with an instant that is too close."""
        return tuple(np.flatnonzero(self.interval_distance < self.clearance - self.tolerance).tolist())

    @property
    def verdict(self) -> str:
        """``"clear"``, ``"undecided"``, ``"too close"`` or ``"overlap"``."""
        if self.safe:
            return "clear"
        if not self.violated:
            return "undecided"
        return "overlap" if self.distance < 0.0 else "too close"

    def __str__(self) -> str:
        return (
            f"'{self.first}' and '{self.second}': {self.verdict}; closest found {self.distance:.6g} at t = "
            f"{_time_text(self.time)}, proven {self.proven:.6g}, asked {self.clearance:g}"
        )


@dataclass(frozen=True, eq=False)
class SafetyReport:
    """The result of `verify_clearance`.

    Attributes
    ----------
    body_pairs : tuple of BodyPairSafety
    between : bool
        False where the points have no order: the report is then about the points alone.
    """

    body_pairs: tuple[BodyPairSafety, ...]
    between: bool = True

    @property
    def safe(self) -> bool:
        """Whether every body pair is proven clear at all times."""
        return all(pair.safe for pair in self.body_pairs)

    @property
    def worst(self) -> BodyPairSafety | None:
        """The body pair that violates its clearance most, or else has least to spare; None without body pairs."""
        return min(self.body_pairs, key=_badness, default=None)

    @property
    def undecided(self) -> tuple[BodyPairSafety, ...]:
        """Body pairs with an interval that is neither proven clear nor found violated."""
        return tuple(pair for pair in self.body_pairs if pair.undecided)

    def table(self) -> str:
        """One line per body pair, the worst first."""
        rows = [("body pair", "asked", "closest found", "at t =", "proven", "verdict")]
        rows += [
            (
                f"{pair.first} - {pair.second}",
                f"{pair.clearance:g}",
                f"{pair.distance:.6g}",
                _time_text(pair.time),
                f"{pair.proven:.6g}",
                pair.verdict,
            )
            for pair in sorted(self.body_pairs, key=_badness)
        ]
        widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
        lines = []
        for row in rows:
            numbers = [text.rjust(width) for text, width in zip(row[1:5], widths[1:5], strict=True)]
            lines.append("  ".join([row[0].ljust(widths[0]), *numbers, row[5]]))
        return "\n".join(lines)

    def __str__(self) -> str:
        where = "at all times" if self.between else "at the points; nothing is known about the motion between them"
        if self.safe:
            count = len(self.body_pairs)
            pairs = "1 body pair keeps its" if count == 1 else f"{count} body pairs keep their"
            return f"clear: {pairs} clearance {where}\n{self.table()}"
        violated = sum(1 for pair in self.body_pairs if pair.violated)
        still_open = sum(1 for pair in self.body_pairs if not pair.safe and not pair.violated)
        return (
            f"NOT SAFE: {violated} of {len(self.body_pairs)} body pairs too close, {still_open} undecided\n"
            f"{self.table()}"
        )


def joined_report(reports: Iterable[SafetyReport]) -> SafetyReport:
    """One report on the body pairs of several."""
    collected = tuple(reports)
    body_pairs = tuple(pair for report in collected for pair in report.body_pairs)
    return SafetyReport(body_pairs, between=all(report.between for report in collected))


def _badness(pair: BodyPairSafety) -> tuple[bool, float]:
    """Sort key: unsafe pairs first, then those with least to spare."""
    return (pair.safe, pair.distance - pair.clearance)


def _time_text(time: Any) -> str:
    return f"{time:.6g}" if isinstance(time, float) else str(time)
