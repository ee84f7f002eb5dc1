"""`SafetyReport`: what is proven about the distances of all pairs, at all times."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PairSafety:
    """One pair of convex parts.

    Attributes
    ----------
    first, second : str
        Names of the parts.
    clearance, tolerance : float
        Asked was ``clearance``; what is proven to ``clearance - tolerance`` counts as kept.
    distance : float
        The smallest signed distance among all instants looked at, by a search in the intervals that are proven least.
        Negative: they overlap.
    proven : float
        The signed distance is at least this at all times.
    time : float
        When `distance` was found, in the user's time; of a set without order, the point.
    interval : int or None
        In which interval; None where points have no order, and nothing is between them.
    interval_distance, interval_proven : array, shape (intervals,)
        The same for each interval, or for each point where there are no intervals. NaN in `interval_distance`: the
        interval was proven clear by its swept boxes and never looked into.
    undecided : tuple of int
        Intervals that are neither proven clear nor found violated; among them those in which a body leaps at a
        node, as guesses and points that are not solved may do, or shrinks between them, by more than the tolerance.
    pieces : int
        Number of stretches that the proof took.
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
    pieces: int

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
        """Intervals (or points) in which an instant was found that is too close."""
        return tuple(np.flatnonzero(self.interval_distance < self.clearance - self.tolerance).tolist())

    @property
    def verdict(self) -> str:
        """In one word."""
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
    """The judgement of `verify_clearance`.

    Attributes
    ----------
    pairs : tuple of PairSafety
    between : bool
        False where the points have no order: then the report is about the points alone.
    """

    pairs: tuple[PairSafety, ...]
    between: bool = True

    @property
    def safe(self) -> bool:
        """Whether every pair is proven clear at all times."""
        return all(pair.safe for pair in self.pairs)

    @property
    def worst(self) -> PairSafety | None:
        """The pair that misses its clearance most, or has least to spare; None without pairs."""
        return min(self.pairs, key=lambda pair: (pair.safe, pair.distance - pair.clearance), default=None)

    @property
    def undecided(self) -> tuple[PairSafety, ...]:
        """Pairs with an interval that is neither proven clear nor found violated."""
        return tuple(pair for pair in self.pairs if pair.undecided)

    def table(self) -> str:
        """One line per pair, the worst first."""
        order = sorted(self.pairs, key=lambda pair: (pair.safe, pair.distance - pair.clearance))
        rows = [("pair", "asked", "closest found", "at t =", "proven", "verdict")]
        rows += [
            (
                f"{pair.first} - {pair.second}",
                f"{pair.clearance:g}",
                f"{pair.distance:.6g}",
                _time_text(pair.time),
                f"{pair.proven:.6g}",
                pair.verdict,
            )
            for pair in order
        ]
        widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
        lines = []
        for row in rows:
            numbers = [text.rjust(width) for text, width in zip(row[1:5], widths[1:5], strict=True)]
            lines.append("  ".join([row[0].ljust(widths[0]), *numbers, row[5]]))
        return "\n".join(lines)

    def __str__(self) -> str:
        where = "at all times" if self.between else "at the points; nothing is said about what is between them"
        if self.safe:
            pairs = "1 pair keeps its" if len(self.pairs) == 1 else f"{len(self.pairs)} pairs keep their"
            return f"clear: {pairs} clearance {where}\n{self.table()}"
        found = sum(1 for pair in self.pairs if pair.violated)
        open_ones = sum(1 for pair in self.pairs if not pair.safe and not pair.violated)
        return f"NOT SAFE: {found} of {len(self.pairs)} pairs too close, {open_ones} undecided\n{self.table()}"


def joined_report(reports: Iterable[SafetyReport]) -> SafetyReport:
    """One report on the pairs of several."""
    found = tuple(reports)
    return SafetyReport(
        tuple(pair for report in found for pair in report.pairs), between=all(report.between for report in found)
    )


def _time_text(time: Any) -> str:
    return f"{time:.6g}" if isinstance(time, float) else str(time)
