"""Links and joints in a plane, drawn as snapshots over time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.optional_imports import matplotlib

from .time_colours import evenly_moved, time_colours

Array = NDArray[np.float64]


def draw_linkage(
    time: Array,
    joints: Array,
    *,
    snapshots: int = 14,
    cart: tuple[float, float] | None = None,
    title: str = "",
    figure: Any = None,
) -> Any:
    """Draw a chain of links at several times, light to dark, with the path of its tip.

    Parameters
    ----------
    time : array, shape (T,)
        Seconds.
    joints : array, shape (T, J, 2)
        Position of each joint from base to tip, metres.
    snapshots : int
        How many times are drawn, with about equal motion between them.
    cart : (width, height), optional
        Draw a cart of this size around the first joint, on a rail.
    title : str
    figure : Figure or SubFigure, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.figure.Figure or SubFigure
    """
    if figure is None:
        figure = matplotlib.figure.Figure(figsize=(6.0, 5.2), layout="constrained")
    axis = figure.subplots()
    colours = time_colours(time)
    if cart is not None:
        axis.axhline(0.0, color="0.7", linewidth=1, zorder=0)
    axis.plot(*joints[:, -1].T, color="0.6", linewidth=1, zorder=1)
    for layer, i in enumerate(evenly_moved(joints, snapshots)):
        colour = colours.to_rgba(time[i])
        if cart is not None:
            corner = joints[i, 0] - np.array(cart) / 2
            axis.add_patch(
                matplotlib.patches.Rectangle(
                    tuple(corner), *cart, facecolor=(*colour[:3], 0.13), edgecolor=colour, zorder=2 + layer
                )
            )
        axis.plot(*joints[i, :-1].T, "o", color=colour, markersize=4, zorder=2.5 + layer)
        axis.plot(*joints[i].T, color=colour, linewidth=2, solid_capstyle="round", zorder=2 + layer)
        axis.plot(*joints[i, -1], "o", color=colour, markersize=7, zorder=2.5 + layer)
    axis.set_aspect("equal", adjustable="datalim")
    axis.margins(0.06)
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]")
    axis.set_title(title)
    axis.grid(alpha=0.25)
    figure.colorbar(colours, ax=axis, label="time [s]")
    return figure
