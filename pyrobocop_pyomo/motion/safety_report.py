"""`SafetyReport`: the distances that are proven for all body pairs, at all times.

A pair is *clear* where the distance is proven of the plan, and *safe* where it is proven of the motion under the plan's
controls as well. What was not looked at has no number, and is neither safe nor unsafe.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.plotting import plot_clearances
from pyrobocop_pyomo.presentation import Presented, aligned

NOT_REPLAYED = "the motion under the controls was not replayed"
_NOT_BY_EQUATIONS = "but not for the motion of its equations"


@dataclass(frozen=True, eq=False)
class BodyPairSafety(Presented):
    """The result for one pair of convex parts of two bodies.

    Attributes
    ----------
    first, second : str
        Names of the parts.
    tolerance : float
        A distance that is proven to ``clearance - tolerance`` counts as kept.
    subintervals : int
        Number of subintervals that the proof used.
    interval_distance : array, shape (intervals,)
        Smallest signed distance of all instants measured in each interval; negative where the parts overlap. Where the
        clearance changes in time, the instant is meant at which the distance exceeds it least. A search measures the
        intervals that are proven least. NaN: the interval was proven clear by boxes, and no instant of it was measured.
    interval_proven : array, shape (intervals,)
        The signed distance is at least this at all times of the interval; at other times with another clearance, it
        exceeds that by at least ``interval_proven - interval_clearance``.
    interval_clearance : array, shape (intervals,)
        What is required at the instant of `interval_distance`; `interval_proven` refers to it.
    interval_deviation : array, shape (intervals,)
        How far the equations lead the parts from where the plan has them, under its controls: infinite where they lead
        out of all bounds, NaN where nobody looked. Distances belong to the plan; this is taken off the proven ones.
    interval_times : array, shape (intervals,)
        When `interval_distance` was found.
    interval_ends : array, shape (intervals, 2)
        Times of the start and the end of each interval.
    not_replayed : str
        Why the motion under the controls was not followed, or not everywhere; empty where it was, or is the plan.
    """

    first: str
    second: str
    tolerance: float
    subintervals: int
    interval_distance: Array = field(repr=False)
    interval_proven: Array = field(repr=False)
    interval_clearance: Array = field(repr=False)
    interval_deviation: Array = field(repr=False)
    interval_times: Array = field(repr=False)
    interval_ends: Array = field(repr=False)
    not_replayed: str = ""

    @cached_property
    def interval(self) -> int:
        """Position of the interval in which the distance exceeds the clearance least."""
        return int(np.nanargmin(self.interval_distance - self.interval_clearance))

    @property
    def time(self) -> float:
        """When `distance` was found."""
        return float(self.interval_times[self.interval])

    @property
    def distance(self) -> float:
        """Smallest of `interval_distance`, or that which exceeds its clearance least."""
        return float(self.interval_distance[self.interval])

    @property
    def clearance(self) -> float:
        """The distance asked for; where it changes in time, that at `time`."""
        return float(self.interval_clearance[self.interval])

    @property
    def proven(self) -> float:
        """The signed distance is at least this at all times; with another clearance it exceeds that by as much."""
        return self.clearance + float((self.interval_proven - self.interval_clearance).min())

    @property
    def safe(self) -> bool | None:
        """Whether the clearance, less the tolerance, is proven at all times, for the plan and under its controls.

        None where it is proven of the plan, and nobody knows the motion under its controls.
        """
        return False if self.unproven else None if self.not_replayed else True

    @property
    def deviation(self) -> float:
        """Largest distance of the motion of the equations from the plan; NaN where it is not known."""
        return float("nan") if self.not_replayed else float(self.interval_deviation.max(initial=0.0))

    @property
    def proven_of_equations(self) -> float:
        """What `proven` is for the motion of the equations; NaN where it is not known."""
        excess = self.proven_of_both - self.interval_clearance
        return float("nan") if self.not_replayed else float(excess.min(initial=np.inf)) + self.clearance

    @property
    def proven_of_both(self) -> Array:
        """By interval: the proven distance of the plan and, as far as known, of the motion of its equations."""
        return self.interval_proven - np.where(np.isnan(self.interval_deviation), 0.0, self.interval_deviation)

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
        return float(np.nanmax(self.missing))

    @property
    def unproven(self) -> tuple[int, ...]:
        """Intervals for which the clearance, less the tolerance, is not proven of both motions."""
        return tuple(np.flatnonzero(~(self.proven_of_both >= self.interval_clearance - self.tolerance)).tolist())

    @property
    def violated(self) -> tuple[int, ...]:
        """Intervals with an instant at which the plan itself is too close."""
        return tuple(np.flatnonzero(self.interval_distance < self.interval_clearance - self.tolerance).tolist())

    @property
    def undecided(self) -> tuple[int, ...]:
        """Intervals that are neither proven clear nor found violated, by either motion.

        Among them are intervals in which a body jumps at a node or is distorted between nodes by more than the
        tolerance, as values that are not a solution may have it.
        """
        return tuple(i for i in self.unproven if i not in (*self.violated, *self.plan_only))

    @property
    def verdict(self) -> str:
        """``"clear"``, ``"plan only"``, ``"undecided"``, ``"too close"`` or ``"overlap"``.

        ``"plan only"`` says that the plan keeps the clearance, but the motion of its equations may not: the mesh is too
        coarse, or the values are no solution.
        """
        if not self.unproven:
            return "clear"
        if self.violated:
            return "overlap" if self.distance < 0.0 else "too close"
        return "plan only" if self.plan_only else "undecided"

    @property
    def plan_only(self) -> tuple[int, ...]:
        """Intervals in which the plan is not too close, but the motion of its equations may be."""
        led_away = (self.missing > self.tolerance) | np.isinf(self.interval_deviation)
        return tuple(i for i in self.unproven if led_away[i] and i not in self.violated)

    def __str__(self) -> str:
        near = f"overlap by {-self.distance:.3g}" if self.distance < 0.0 else f"are {self.distance:.3g} apart"
        of_equations = (
            "" if self.not_replayed else f" and {self.proven_of_equations:.3g} for the motion of its equations"
        )
        proven = f"; {self.verdict}: proven {self.proven:.3g} for the plan{of_equations}"
        return (
            f"'{self.first}' and '{self.second}' {near} at t = {self.time:.6g}, required clearance "
            f"{self.clearance:g}{proven if self.unproven and not self.violated else ''}"
        )


@dataclass(frozen=True, eq=False)
class SafetyReport(Presented):
    """The result of `verify_clearance`.

    Attributes
    ----------
    body_pairs : tuple of BodyPairSafety
    motion : str
        Which motion between the points the report is about, in words.
    motion_is_assumed : bool
        Whether nothing in the model says that the motion is this one.
    equations : str
        How the motion of the equations was found, and how far it is from the plan; empty where there are none, and
        where it is not known.
    """

    body_pairs: tuple[BodyPairSafety, ...]
    motion: str = ""
    motion_is_assumed: bool = False
    equations: str = ""

    @property
    def safe(self) -> bool | None:
        """Whether every body pair is proven to keep its clearance at all times, also under the plan's controls.

        None where all are proven clear, and nobody knows the motion under the controls: `not_replayed` says why.
        """
        verdicts = [pair.safe for pair in self.body_pairs]
        return False if False in verdicts else None if None in verdicts else True

    @property
    def not_replayed(self) -> str:
        """Why the motion under the plan's controls is not known; empty where it is, or where it is the plan."""
        return " ".join(dict.fromkeys(pair.not_replayed for pair in self.body_pairs if pair.not_replayed))

    @property
    def word(self) -> str:
        """What is known, in few words: safe, clear, or not safe, and on which kind of motion."""
        lines = " along straight lines" if self.motion_is_assumed else ""
        kept = f"safe{lines}" if self.safe else f"clear{lines}; {NOT_REPLAYED}: {self.not_replayed}"
        return "NOT SAFE" if self.safe is False else kept

    @property
    def worst(self) -> BodyPairSafety | None:
        """The body pair that violates its clearance most, or else has least to spare; None without body pairs."""
        return min(self.body_pairs, key=_badness, default=None)

    def plot(self, figure: Any = None) -> Any:
        """Draw distances over time: required, proven of both motions, and at the closest instants.

        Parameters
        ----------
        figure : Figure or SubFigure, optional
            Where to draw; a new figure by default.

        Returns
        -------
        matplotlib.figure.Figure or SubFigure
        """
        shown = sorted(self.body_pairs, key=_badness)
        return plot_clearances(self.word.partition(":")[0], shown, figure=figure)

    def _rows(self) -> list[tuple[str, ...]]:
        """The header, and one row per body pair, the worst first."""
        header = ("body pair", "asked", "closest found", "at t =", "proven", "of equations", "verdict")
        rows = [
            (
                f"{pair.first} - {pair.second}",
                f"{pair.clearance:.6g}",
                f"{pair.distance:.6g}",
                f"{pair.time:.6g}",
                f"{pair.proven:.6g}",
                "not known" if pair.not_replayed else f"{pair.proven_of_equations:.6g}",
                pair.verdict,
            )
            for pair in sorted(self.body_pairs, key=_badness)
        ]
        both = bool(self.equations or self.not_replayed)
        return [row if both else (*row[:5], row[6]) for row in (header, *rows)]

    def table(self) -> str:
        """One line per body pair, the worst first."""
        rows = self._rows()
        return aligned(rows, ["<", *">" * (len(rows[0]) - 2), "<"])

    def __str__(self) -> str:
        of_motion = f"; motion: {self.motion}" if self.motion else ""
        count = len(self.body_pairs)
        pairs = "1 body pair keeps its" if count == 1 else f"{count} body pairs keep their"
        about = [self.equations] if self.equations else []
        if self.safe is not False:
            joint = ": " if self.safe else " "  # after a sentence that says why a motion is not known
            return "\n".join([f"{self.word}{joint}{pairs} clearance at all times{of_motion}", *about, self.table()])
        violated = sum(1 for pair in self.body_pairs if pair.violated)
        plan_only = sum(1 for pair in self.body_pairs if pair.verdict == "plan only")
        still_open = sum(1 for pair in self.body_pairs if pair.unproven and not pair.violated) - plan_only
        by_plan = f", {plan_only} clear for the plan, {_NOT_BY_EQUATIONS}" if plan_only else ""
        about += [f"{NOT_REPLAYED}: {self.not_replayed}"] if self.not_replayed else []
        first = f"{self.word}: {violated} of {count} body pairs too close, {still_open} undecided{by_plan}{of_motion}"
        return "\n".join([first, *about, self.table()])


def joined_report(reports: Iterable[SafetyReport]) -> SafetyReport:
    """One report on the body pairs of several."""
    collected = tuple(reports)
    body_pairs = tuple(pair for report in collected for pair in report.body_pairs)
    motions = dict.fromkeys(report.motion for report in collected if report.motion)
    equations = dict.fromkeys(report.equations for report in collected if report.equations)
    return SafetyReport(
        body_pairs,
        motion="; ".join(motions),
        motion_is_assumed=any(report.motion_is_assumed for report in collected),
        equations="\n".join(equations),
    )


def _badness(pair: BodyPairSafety) -> tuple[bool, float]:
    """Sort key: unsafe pairs first, then those with least to spare."""
    return (not pair.unproven, -pair.shortfall)
