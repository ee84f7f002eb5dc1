"""`SafetyReport`: the distances that are proven for all body pairs, at all times."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.plotting import ClearanceCurve, plot_clearances
from pyrobocop_pyomo.presentation import Presented, disclosed_text, table

_NOT_BY_EQUATIONS = "but not for the motion of its equations"


@dataclass(frozen=True, eq=False)
class BodyPairSafety(Presented):
    """The result for one pair of convex parts of two bodies.

    Attributes
    ----------
    first, second : str
        Names of the parts.
    clearance, tolerance : float
        The distance asked for is ``clearance``; one that is proven to ``clearance - tolerance`` counts as kept. Where
        the clearance changes in time, it is that at `time`.
    distance : float
        Smallest signed distance of all instants measured; a search measures the intervals that are proven least.
        Negative: the parts overlap. Where the clearance changes in time, the instant is meant at which the distance
        exceeds it least.
    proven : float
        The signed distance is at least this at all times; at other times with another clearance, it exceeds that by at
        least ``proven - clearance``.
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
    interval_clearance : array, shape (intervals,)
        What is required at the instant of `interval_distance`; `interval_proven` refers to it.
    interval_deviation : array, shape (intervals,)
        How far the equations lead the parts from where the plan has them, under its controls; infinite where that is
        not known. Distances are those of the plan; this is taken off what is proven for it.
    preferred : float or None
        A larger clearance that was preferred, where there is one; `safe` says nothing about it.
    interval_ends : array, shape (intervals, 2), optional
        Times of the start and the end of each interval; None for points without order.
    interval_times : array, shape (intervals,), optional
        When `interval_distance` was found.
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
    interval_clearance: Array = field(repr=False)
    interval_deviation: Array = field(repr=False)
    preferred: float | None = None
    interval_ends: Array | None = field(default=None, repr=False)
    interval_times: Array | None = field(default=None, repr=False)

    @classmethod
    def at_points(
        cls, first: str, second: str, points: Sequence[Any], distances: Array, required: Array, tolerance: float
    ) -> BodyPairSafety:
        """At points without an order: what is measured there is all there is to prove."""
        worst = int(np.argmin(distances - required))
        return cls(
            first=first,
            second=second,
            clearance=float(required[worst]),
            tolerance=tolerance,
            distance=float(distances[worst]),
            proven=float(distances[worst]),
            time=points[worst],
            interval=None,
            interval_distance=distances,
            interval_proven=distances,
            interval_clearance=required,
            interval_deviation=np.zeros(len(distances)),
            undecided=(),
            subintervals=len(distances),
        )

    @property
    def safe(self) -> bool:
        """Whether the clearance, less the tolerance, is proven at all times, for the plan and for its equations."""
        return not self.unproven

    @property
    def deviation(self) -> float:
        """Largest distance of the motion of the equations from the plan."""
        return float(self.interval_deviation.max(initial=0.0))

    @property
    def proven_of_equations(self) -> float:
        """What `proven` is for the motion of the equations."""
        excess = self.interval_proven - self.interval_clearance - self.interval_deviation
        return float(excess.min(initial=np.inf)) + self.clearance

    @property
    def missing(self) -> Array:
        """By interval: how much farther apart the plan has to be for both motions; NaN where it was not measured.

        A motion of the equations that is not known, or leaves all bounds, counts as the plan: no distance would do.
        """
        deviation = np.where(np.isfinite(self.interval_deviation), self.interval_deviation, 0.0)
        return self.interval_clearance + deviation - self.interval_distance

    @property
    def shortfall(self) -> float:
        """The largest of `missing`: by how much a motion comes too close; negative where there is room left."""
        return float(np.nanmax(np.append(self.missing, self.clearance - self.distance)))

    @property
    def unproven(self) -> tuple[int, ...]:
        """Intervals (or points) for which the clearance, less the tolerance, is not proven of both motions."""
        proven = self.interval_proven - self.interval_deviation
        return tuple(np.flatnonzero(~(proven >= self.interval_clearance - self.tolerance)).tolist())

    @property
    def plan_is_proven(self) -> bool:
        """Whether the clearance is proven of the plan, wherever the motion of its equations is not known."""
        proven = self.interval_proven >= self.interval_clearance - self.tolerance
        return bool(np.all(proven & ~np.isfinite(self.interval_deviation)))

    @property
    def violated(self) -> tuple[int, ...]:
        """Intervals (or points) with an instant at which the plan itself is too close."""
        return tuple(np.flatnonzero(self.interval_distance < self.interval_clearance - self.tolerance).tolist())

    @property
    def verdict(self) -> str:
        """``"clear"``, ``"plan only"``, ``"undecided"``, ``"too close"`` or ``"overlap"``.

        It is the plan only that keeps the clearance where the motion of its equations may not: on a mesh that is too
        coarse, or with values that are no solution.
        """
        if self.safe:
            return "clear"
        if self.violated:
            return "overlap" if self.distance < 0.0 else "too close"
        return "plan only" if self.plan_only else "undecided"

    @property
    def plan_only(self) -> tuple[int, ...]:
        """Intervals in which the plan is not too close, but the motion of its equations may be."""
        led_away = (self.missing > self.tolerance) | ~np.isfinite(self.interval_deviation)
        return tuple(i for i in self.unproven if led_away[i] and i not in self.violated)

    def __str__(self) -> str:
        near = f"overlap by {-self.distance:.3g}" if self.distance < 0.0 else f"are {self.distance:.3g} apart"
        proven = (
            f"; {self.verdict}: proven {self.proven:.3g} for the plan and {self.proven_of_equations:.3g} for the "
            "motion of its equations"
        )
        return (
            f"'{self.first}' and '{self.second}' {near} at t = {_time_text(self.time)}, required clearance "
            f"{self.clearance:g}{'' if self.safe or self.violated else proven}"
        )


@dataclass(frozen=True, eq=False)
class SafetyReport(Presented):
    """The result of `verify_clearance`.

    Attributes
    ----------
    body_pairs : tuple of BodyPairSafety
    between : bool
        False where the points have no order: the report is then about the points alone.
    motion : str
        Which motion between the points the report is about, in words.
    motion_is_assumed : bool
        Whether nothing in the model says that the motion is this one.
    equations : str
        How the motion of the equations was found, and how far it is from the plan; empty where there are none.
    equations_unknown : bool
        Whether there are equations whose motion is not known, for the reason that `equations` says.
    """

    body_pairs: tuple[BodyPairSafety, ...]
    between: bool = True
    motion: str = ""
    motion_is_assumed: bool = False
    equations: str = ""
    equations_unknown: bool = False

    @property
    def safe(self) -> bool:
        """Whether every body pair is proven clear at all times; what is not known is never safe."""
        return all(pair.safe for pair in self.body_pairs)

    @property
    def is_settled(self) -> bool:
        """Whether no other plan would be proven better: safe, but for equations whose motion is not known."""
        return all(pair.safe or (self.equations_unknown and pair.plan_is_proven) for pair in self.body_pairs)

    @property
    def worst(self) -> BodyPairSafety | None:
        """The body pair that violates its clearance most, or else has least to spare; None without body pairs."""
        return min(self.body_pairs, key=_badness, default=None)

    @property
    def undecided(self) -> tuple[BodyPairSafety, ...]:
        """Body pairs with an interval that is neither proven clear nor found violated."""
        return tuple(pair for pair in self.body_pairs if pair.undecided)

    def plot(self, figure: Any = None, *, most: int = 6) -> Any:
        """Draw the distances over time: what is required, what is proven of both motions, and the closest instants.

        Parameters
        ----------
        figure : Figure or SubFigure, optional
            Where to draw; a new figure by default.
        most : int
            How many body pairs get a line of their own: those with least to spare.

        Returns
        -------
        matplotlib.figure.Figure or SubFigure
        """
        shown = sorted(self.body_pairs, key=_badness)
        curves = [
            ClearanceCurve(
                name=f"{pair.first} - {pair.second}",
                asked=pair.interval_clearance,
                proven=pair.interval_proven - pair.interval_deviation,
                found=pair.interval_distance,
                ends=pair.interval_ends,
                times=pair.interval_times,
            )
            for pair in shown
        ]
        return plot_clearances("clear" if self.safe else "NOT SAFE", curves, most=most, figure=figure)

    def table(self) -> str:
        """One line per body pair, the worst first."""
        preferences = any(pair.preferred is not None for pair in self.body_pairs)
        rows: list[tuple[str, ...]] = [
            ("body pair", "asked", "closest found", "at t =", "proven", "of equations", "verdict")
        ]
        rows += [
            (
                f"{pair.first} - {pair.second}",
                f"{pair.clearance:.6g}",
                f"{pair.distance:.6g}",
                _time_text(pair.time),
                f"{pair.proven:.6g}",
                f"{pair.proven_of_equations:.6g}",
                pair.verdict + (_preference_text(pair) if preferences else ""),
            )
            for pair in sorted(self.body_pairs, key=_badness)
        ]
        if not self.equations:
            rows = [(*row[:5], row[6]) for row in rows]
        widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
        lines = []
        for row in rows:
            numbers = [text.rjust(width) for text, width in zip(row[1:-1], widths[1:-1], strict=True)]
            lines.append("  ".join([row[0].ljust(widths[0]), *numbers, row[-1]]))
        return "\n".join(lines)

    def _html_parts(self) -> list[str]:
        header = ("body pair", "asked", "closest found", "at t =", "proven", "verdict")
        rows = [
            (
                f"{pair.first} - {pair.second}",
                pair.clearance,
                pair.distance,
                _time_text(pair.time),
                pair.proven,
                pair.verdict,
            )
            for pair in sorted(self.body_pairs, key=_badness)
        ]
        return [table(header, rows), disclosed_text("as text", str(self))]

    def __str__(self) -> str:
        about = f"{self.equations}\n" if self.equations else ""
        where = "at all times" if self.between else "at the points"
        of_motion = f"; motion: {self.motion}" if self.motion else ""
        if self.safe:
            count = len(self.body_pairs)
            pairs = "1 body pair keeps its" if count == 1 else f"{count} body pairs keep their"
            return f"clear: {pairs} clearance {where}{of_motion}\n{about}{self.table()}"
        violated = sum(1 for pair in self.body_pairs if pair.violated)
        plan_only = sum(1 for pair in self.body_pairs if pair.verdict == "plan only")
        still_open = sum(1 for pair in self.body_pairs if not pair.safe and not pair.violated) - plan_only
        why = "but the motion of its equations is not known" if self.equations_unknown else _NOT_BY_EQUATIONS
        by_plan = f", {plan_only} clear for the plan, {why}" if plan_only else ""
        return (
            f"NOT SAFE: {violated} of {len(self.body_pairs)} body pairs too close, {still_open} undecided{by_plan}"
            f"{of_motion}\n{about}{self.table()}"
        )


def joined_report(reports: Iterable[SafetyReport]) -> SafetyReport:
    """One report on the body pairs of several."""
    collected = tuple(reports)
    body_pairs = tuple(pair for report in collected for pair in report.body_pairs)
    motions = dict.fromkeys(report.motion for report in collected if report.motion)
    equations = dict.fromkeys(report.equations for report in collected if report.equations)
    return SafetyReport(
        body_pairs,
        between=all(report.between for report in collected),
        motion="; ".join(motions),
        motion_is_assumed=any(report.motion_is_assumed for report in collected),
        equations="\n".join(equations),
        equations_unknown=any(report.equations_unknown for report in collected),
    )


def _preference_text(pair: BodyPairSafety) -> str:
    if pair.preferred is None:
        return ""
    missed = pair.preferred - pair.distance
    return f", {pair.preferred:g} preferred" + (f" and missed by {missed:.3g}" if missed > pair.tolerance else "")


def _badness(pair: BodyPairSafety) -> tuple[bool, float]:
    """Sort key: unsafe pairs first, then those with least to spare."""
    return (pair.safe, -pair.shortfall)


def _time_text(time: Any) -> str:
    return f"{time:.6g}" if isinstance(time, float) else str(time)
