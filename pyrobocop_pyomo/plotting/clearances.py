"""Distances over time: what is required of each body pair, what is proven, and the closest instants found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.numerics import Array

from .figures import figure_or_new


@dataclass(frozen=True, eq=False)
class ClearanceCurve:
    """What is known of the distance of one body pair.

    Attributes
    ----------
    name : str
    asked : array, shape (intervals,)
    proven : array, shape (intervals,)
        Lower bound on each interval; minus infinity where there is none.
    found : array, shape (intervals,)
        Smallest distance measured in each interval; NaN where none was measured.
    ends : array, shape (intervals, 2), or None
        Times of both ends of each interval; None for single points, which are numbered.
    times : array, shape (intervals,), or None
        When the smallest distance was found.
    """

    name: str
    asked: Array
    proven: Array
    found: Array
    ends: Array | None = None
    times: Array | None = None

    @property
    def spans(self) -> Array:
        """Both ends of each interval, shape (intervals, 2); points are drawn as wide as their distance."""
        if self.ends is not None:
            return self.ends
        places = np.arange(len(self.proven), dtype=float)
        return np.column_stack([places - 0.5, places + 0.5])


def plot_clearances(title: str, curves: Sequence[ClearanceCurve], *, most: int = 6, figure: Any = None) -> Any:
    """Draw one line per body pair for what is proven, dots for what was measured, a dashed line for what is required.

    Parameters
    ----------
    title : str
    curves : sequence of ClearanceCurve
        Those with least to spare first.
    most : int
        How many get a line of their own; the smallest values of the others are one grey line.
    figure : Figure or SubFigure, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.figure.Figure or SubFigure
    """
    figure = figure_or_new(figure, 7.2, 4.0)
    axis = figure.subplots()
    axis.set_title(title, color="0.1" if title == "clear" else "C3")
    drawn, rest = curves[:most], curves[most:]
    for i, curve in enumerate(drawn):
        colour = f"C{i}"
        _steps(axis, curve.spans, curve.proven, color=colour, linewidth=1.6, label=curve.name)
        times = curve.times if curve.times is not None else curve.spans.mean(axis=1)
        axis.plot(times, curve.found, "o", color=colour, markersize=3, zorder=3)
    for curve in rest:
        label = f"{len(rest)} others" if curve is rest[0] else None
        _steps(axis, curve.spans, curve.proven, color="0.75", linewidth=0.8, zorder=1, label=label)
    for curve in drawn:
        label = "asked" if curve is drawn[0] else None
        dashed = {"linewidth": 1.2, "linestyle": (0, (5, 3)), "zorder": 4}
        _steps(axis, curve.spans, curve.asked, color="black", label=label, **dashed)
    axis.axhline(0.0, color="C3", linewidth=0.8, zorder=1)
    axis.axhspan(-1e9, 0.0, color="C3", alpha=0.06, linewidth=0)
    axis.set_ylim(*_limits(drawn))
    axis.set_xlabel("time" if all(curve.ends is not None for curve in curves) else "point")
    axis.set_ylabel("distance: line proven, dot found")
    axis.grid(alpha=0.3)
    if curves:
        axis.margins(x=0.01)
        figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize="small")
    return figure


def _steps(axis: Any, spans: Array, values: Array, **style: Any) -> None:
    """A level per interval, with a gap where the next one does not follow, or where nothing is known."""
    times, levels = [], []
    for k, ((start, end), level) in enumerate(zip(spans.tolist(), values.tolist(), strict=True)):
        times += [start, end]
        levels += [level if np.isfinite(level) else np.nan] * 2
        if k + 1 < len(spans) and spans[k + 1, 0] != end:
            times.append(end)
            levels.append(np.nan)
    axis.plot(times, levels, **style)


def _limits(curves: Sequence[ClearanceCurve]) -> tuple[float, float]:
    """From below the smallest distance to some times the clearance, or to the largest distance if that is less."""
    asked = max((float(curve.asked.max(initial=0.0)) for curve in curves), default=1.0)
    known = [values[np.isfinite(values)] for curve in curves for values in (curve.proven, curve.found)]
    joined = np.concatenate([*known, [asked]])
    # The pair with most to spare of those drawn is to be seen at its closest.
    closest = max((float(values.min()) for values in known if values.size), default=asked)
    # Larger distances are off the picture: what counts is near the line that is requested.
    high = min(float(joined.max()), max(8.0 * asked, 1.5 * closest))
    low = min(0.0, float(joined.min()))
    return low - 0.05 * (high - low), high + 0.1 * (high - low)
