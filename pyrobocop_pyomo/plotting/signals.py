"""Signals over time, and marks where phases begin and end."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pyrobocop_pyomo.numerics import Array

from .figures import figure_or_new

_MOST_DOTS = 120  # beyond, they merge and hide the line
_POINTS_PER_LETTER = 4.5  # of the small font, about


def plot_signals(
    title: str,
    time: Array,
    values: Mapping[str, Array],
    nodes: Mapping[str, tuple[Array, Array]],
    steps: set[str],
    *,
    labels: Mapping[str, str] | None = None,
    figure: Any = None,
) -> Any:
    """One panel per signal, the interpolation as a line, the nodes as dots where they are not too many.

    Parameters
    ----------
    title : str
    time : array, shape (m,)
        Where the interpolation was evaluated.
    values : mapping of name to array, shape (m,)
        A NaN breaks the line.
    nodes : mapping of name to (times, values)
    steps : set of str
        Names drawn as steps.
    labels : mapping of name to str, optional
        What to write beside an axis instead of the name.
    figure : Figure or SubFigure, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.figure.Figure or SubFigure
        Not shown: that is the caller's choice.
    """
    columns = 1 if len(values) <= 4 else 2
    rows = -(-len(values) // columns)
    figure = figure_or_new(figure, 4.2 * columns + 1, 1.5 * rows + 0.8)
    axes = np.atleast_1d(figure.subplots(rows, columns, sharex=True, squeeze=False)).ravel()
    for axis, name in zip(axes, values, strict=False):
        if name in steps:
            # A value belongs to the element that ends at its time, hence a step before the point.
            axis.step(time, values[name], where="pre", linewidth=1.4)
        else:
            axis.plot(time, values[name], linewidth=1.4)
            if len(nodes[name][0]) <= _MOST_DOTS:
                axis.plot(*nodes[name], ".", markersize=3, color="0.35")
        show_no_noise(axis, values[name])
        axis.set_ylabel((labels or {}).get(name, name))
        axis.grid(alpha=0.3)
    for axis in axes[len(values) :]:
        axis.set_visible(False)
    for axis in axes[max(len(values) - columns, 0) : len(values)]:
        axis.set_xlabel("time")
        axis.tick_params(labelbottom=True)
    figure.align_ylabels(axes)
    if title:
        figure.suptitle(title)
    return figure


def show_no_noise(axis: Any, values: Array) -> None:
    """A constant up to the solver's tolerance is drawn as a constant, not stretched over the panel."""
    lowest, highest = float(np.nanmin(values)), float(np.nanmax(values))
    least = max(1e-4 * max(abs(lowest), abs(highest)), 1e-6)
    if highest - lowest < least:
        middle = (lowest + highest) / 2
        half = max(0.1 * abs(middle), least)
        axis.set_ylim(middle - half, middle + half)


def mark_phases(figure: Any, boundaries: Array, names: Sequence[str]) -> None:
    """Shade every other phase, or run of a solve, in each panel, and write the names above the topmost panels.

    Parameters
    ----------
    figure : Figure or SubFigure
        As `plot_signals` gives it.
    boundaries : array, shape (len(names) + 1,)
        Where phases begin and end.
    names : sequence of str
    """
    spans = list(itertools.pairwise(boundaries.tolist()))
    axes = [axis for axis in figure.axes if axis.get_visible()]
    for axis in axes:
        for i, (start, end) in enumerate(spans):
            if i % 2:
                axis.axvspan(start, end, color="0.93", zorder=0, linewidth=0)
        axis.set_xlim(boundaries[0], boundaries[-1])
    places = [axis.get_subplotspec().get_position(figure) for axis in axes]
    top = max(place.y1 for place in places)
    for axis, place in zip(axes, places, strict=True):
        if top - place.y1 > 1e-9:
            continue
        points_per_second = 0.85 * place.width * figure.bbox.width * 72 / figure.dpi / (boundaries[-1] - boundaries[0])
        for (start, end), name in zip(spans, names, strict=True):
            # The name, or only its index where it is wider than its phase, or nothing where the index is too wide.
            most = points_per_second * (end - start) / _POINTS_PER_LETTER
            index = name[name.index("[") + 1 : -1] if name.endswith("]") else name
            shown = next((text for text in (name, index) if len(text) <= most), "")
            above = {"transform": axis.get_xaxis_transform(), "horizontalalignment": "center"}
            axis.text((start + end) / 2, 1.03, shown, fontsize="small", color="0.35", **above)
