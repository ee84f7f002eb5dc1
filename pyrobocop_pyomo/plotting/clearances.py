"""Distances over time: what is required of each body pair, what is proven, and the closest instants found."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pyrobocop_pyomo.numerics import Array

from .figures import figure_or_new


def plot_clearances(title: str, pairs: Sequence[Any], *, most: int = 6, figure: Any = None) -> Any:
    """Draw one line per body pair for what is proven, dots for what was measured, a dashed line for what is required.

    Parameters
    ----------
    title : str
    pairs : sequence of BodyPairSafety
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
    axis.set_title(title, color="0.1" if all(pair.safe is not False for pair in pairs) else "C3")
    drawn, rest = pairs[:most], pairs[most:]
    for i, pair in enumerate(drawn):
        colour, spans = f"C{i}", _spans(pair)
        _steps(axis, spans, pair.proven_of_both, color=colour, linewidth=1.6, label=f"{pair.first} - {pair.second}")
        times = pair.interval_times if pair.interval_ends is not None else spans.mean(axis=1)
        axis.plot(times, pair.interval_distance, "o", color=colour, markersize=3, zorder=3)
    for pair in rest:
        label = f"{len(rest)} others" if pair is rest[0] else None
        _steps(axis, _spans(pair), pair.proven_of_both, color="0.75", linewidth=0.8, zorder=1, label=label)
    for pair in drawn:
        label = "asked" if pair is drawn[0] else None
        dashed = {"linewidth": 1.2, "linestyle": (0, (5, 3)), "zorder": 4}
        _steps(axis, _spans(pair), pair.interval_clearance, color="black", label=label, **dashed)
    axis.axhline(0.0, color="C3", linewidth=0.8, zorder=1)
    axis.axhspan(-1e9, 0.0, color="C3", alpha=0.06, linewidth=0)
    axis.set_ylim(*_limits(drawn))
    axis.set_xlabel("time" if all(pair.interval_ends is not None for pair in pairs) else "point")
    axis.set_ylabel("distance: line proven, dot found")
    axis.grid(alpha=0.3)
    if pairs:
        axis.margins(x=0.01)
        figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize="small")
    return figure


def _spans(pair: Any) -> Array:
    """Both ends of each interval, shape (intervals, 2); single points are numbered, and as wide as their distance."""
    if pair.interval_ends is not None:
        return np.asarray(pair.interval_ends)
    places = np.arange(len(pair.interval_proven), dtype=float)
    return np.column_stack([places - 0.5, places + 0.5])


def _steps(axis: Any, spans: Array, values: Array, **style: Any) -> None:
    """A level per interval, with a gap where the next one does not follow, or where nothing is known."""
    breaks = 1 + np.flatnonzero(spans[1:, 0] != spans[:-1, 1])
    times = np.insert(spans.ravel(), 2 * breaks, spans[breaks - 1, 1])
    levels = np.repeat(np.where(np.isfinite(values), values, np.nan), 2)
    axis.plot(times, np.insert(levels, 2 * breaks, np.nan), **style)


def _limits(pairs: Sequence[Any]) -> tuple[float, float]:
    """From below the smallest distance to some times the clearance, or to the largest distance if that is less."""
    asked = max((float(pair.interval_clearance.max(initial=0.0)) for pair in pairs), default=1.0)
    levels = [values for pair in pairs for values in (pair.proven_of_both, pair.interval_distance)]
    known = [values[np.isfinite(values)] for values in levels]
    joined = np.concatenate([*known, [asked]])
    # The pair with most to spare of those drawn is to be seen at its closest.
    closest = max((float(values.min()) for values in known if values.size), default=asked)
    # Larger distances are off the picture: what counts is near the line that is requested.
    high = min(float(joined.max()), max(8.0 * asked, 1.5 * closest))
    low = min(0.0, float(joined.min()))
    return low - 0.05 * (high - low), high + 0.1 * (high - low)
