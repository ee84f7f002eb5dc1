"""Complementarity as pictures: both sides of pairs over their index, and products against their bound."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.optional_imports import matplotlib

Array = NDArray[np.float64]

_MOST_LABELS = 20


def plot_pair_sides(
    title: str,
    place: Array,
    first: Array,
    second: Array,
    *,
    zero: float = 1e-6,
    labels: Sequence[str] | None = None,
    axis_label: str = "index",
    figure: Any = None,
) -> Any:
    """Two panels, one per side; filled dots where the side is zero, shading where both are.

    Parameters
    ----------
    title : str
    place : array, shape (k,)
        Where each pair stands: time, or number of the pair.
    first, second : array, shape (k,)
        Values of the sides.
    zero : float
        A side of at most this size counts as zero.
    labels : sequence of str, optional
        What to write below the places instead of numbers.
    axis_label : str
    figure : Figure or SubFigure, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.figure.Figure or SubFigure
    """
    if figure is None:
        figure = matplotlib.figure.Figure(figsize=(7.2, 4.2), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    both = (np.abs(first) <= zero) & (np.abs(second) <= zero)
    gaps = np.diff(place)
    half = 0.5 * float(np.median(gaps)) if gaps.size and np.median(gaps) > 0 else 0.5
    for axis, values, name, colour in zip(
        axes, (first, second), ("first side", "second side"), ("C0", "C1"), strict=True
    ):
        if labels is None:
            axis.plot(place, values, color=colour, linewidth=1.2, zorder=2)
        held = np.abs(values) <= zero
        axis.plot(place[~held], values[~held], "o", color=colour, markersize=4, markerfacecolor="white", zorder=3)
        axis.plot(place[held], values[held], "o", color=colour, markersize=4, zorder=3)
        for at in place[both].tolist():
            axis.axvspan(at - half, at + half, color="0.9", zorder=0, linewidth=0)
        axis.axhline(0.0, color="0.6", linewidth=0.8, zorder=1)
        axis.set_ylabel(name)
        axis.grid(alpha=0.3)
        axis.margins(x=0.02)
    axes[1].set_xlabel(axis_label)
    if labels is not None:
        every = -(-len(labels) // _MOST_LABELS)
        axes[1].set_xticks(place[::every], list(labels)[::every], rotation=45, ha="right")
    lines = matplotlib.lines
    handles = [
        lines.Line2D([], [], marker="o", color="0.3", linestyle="", markersize=4, label="zero"),
        lines.Line2D(
            [], [], marker="o", color="0.3", linestyle="", markersize=4, markerfacecolor="white", label="positive"
        ),
    ]
    if both.any():
        handles.append(matplotlib.patches.Patch(color="0.9", label="biactive"))
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize="small")
    if title:
        figure.suptitle(title)
    return figure


def plot_products(title: str, delta: Array, product: Array, natural: Array, *, figure: Any = None) -> Any:
    """Largest product and largest ``|min(a, b)|`` of each run against the bound of the products, both logarithmic.

    Parameters
    ----------
    title : str
    delta : array, shape (s,)
        Positive.
    product, natural : array, shape (s,)
    figure : Figure or SubFigure, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.figure.Figure or SubFigure
    """
    if figure is None:
        figure = matplotlib.figure.Figure(figsize=(5.6, 4.4), layout="constrained")
    axis = figure.subplots()
    floor = min(1e-12, 1e-2 * float(delta.min()))  # exact zeros are drawn here
    range_of = np.array([delta.min() / 3, delta.max() * 3])
    axis.plot(range_of, range_of, color="0.5", linewidth=1, label="product = delta")
    axis.plot(range_of, np.sqrt(range_of), color="0.5", linewidth=1, linestyle=(0, (4, 3)), label="side = sqrt(delta)")
    axis.plot(delta, np.maximum(product, floor), "o", markersize=5, label="largest product")
    axis.plot(delta, np.maximum(natural, floor), "s", markersize=5, label="largest |min(first, second)|")
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.invert_xaxis()  # a solve goes from loose to tight
    axis.set_xlabel("delta")
    axis.set_ylabel("residual")
    axis.grid(alpha=0.3)
    axis.legend(fontsize="small")
    axis.set_title(title)
    return figure
