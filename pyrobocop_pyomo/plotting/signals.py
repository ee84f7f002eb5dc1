"""Signals over time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.optional_imports import matplotlib

Array = NDArray[np.float64]

_MOST_DOTS = 120  # beyond, they merge and hide the line


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
    if figure is None:
        # The object interface, not pyplot: no global figure list grows, and no display is asked for.
        figure = matplotlib.figure.Figure(figsize=(4.2 * columns + 1, 1.5 * rows + 0.8), layout="constrained")
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
