"""A slider pushed in the plane, drawn as snapshots over time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.optional_imports import matplotlib

Array = NDArray[np.float64]


def draw_planar_pushing(
    time: Array,
    pose: Array,
    contact: Array,
    *,
    half_side: float,
    pusher_radius: float = 0.005,
    snapshots: int = 12,
    title: str = "",
    force: Array | None = None,
) -> Any:
    """Draw the slider and the pusher at several times, light to dark, with the path of the slider's centre.

    Parameters
    ----------
    time : array, shape (T,)
        Seconds.
    pose : array, shape (T, 3)
        Position of the centre (metres) and rotation (radians) of the slider.
    contact : array, shape (T, 2)
        Contact point in the slider's frame, metres.
    half_side : float
        Half the side of the square slider, metres.
    pusher_radius : float
        Radius of the pusher, metres; it touches the slider from outside its nearest face.
    snapshots : int
        How many times are drawn.
    title : str
    force : array, shape (T, 2), optional
        Contact force in the slider's frame, newtons; drawn as arrows scaled to the slider.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = matplotlib.figure.Figure(figsize=(6.4, 6.0), layout="constrained")
    axis = figure.subplots()
    colours = matplotlib.colormaps["viridis_r"]
    chosen = np.unique(np.searchsorted(time, np.linspace(time[0], time[-1], snapshots)).clip(0, len(time) - 1))
    corners = half_side * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=float)
    axis.plot(pose[:, 0], pose[:, 1], color="0.6", linewidth=1, zorder=1, label="centre of the slider")
    largest = np.abs(force).max() if force is not None and np.abs(force).max() > 0 else 1.0
    for i in chosen:
        colour = colours(0.1 + 0.85 * (time[i] - time[0]) / max(time[-1] - time[0], 1e-12))
        x, y, theta = pose[i]
        turn = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
        outline = corners @ turn.T + [x, y]
        axis.add_patch(matplotlib.patches.Polygon(outline, fill=False, edgecolor=colour, linewidth=1.6, zorder=2))
        # A tick on the face that points along the body's x axis shows the rotation of a square.
        mark = np.array([[0.6 * half_side, 0.0], [half_side, 0.0]]) @ turn.T + [x, y]
        axis.plot(mark[:, 0], mark[:, 1], color=colour, linewidth=1.6, zorder=2)
        touching = turn @ contact[i] + [x, y]
        outward = turn @ _outward_normal(contact[i])
        centre = touching + pusher_radius * outward
        axis.add_patch(matplotlib.patches.Circle(centre, pusher_radius, color=colour, zorder=3))
        if force is not None:
            arrow = turn @ force[i] * (1.2 * half_side / largest)
            axis.annotate(
                "",
                xy=touching,
                xytext=touching - arrow,
                arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1, "alpha": 0.7},
                zorder=3,
            )
    axis.set_aspect("equal")
    axis.autoscale_view()
    axis.margins(0.08)
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]")
    axis.set_title(title)
    axis.grid(alpha=0.25)
    scale = matplotlib.cm.ScalarMappable(matplotlib.colors.Normalize(time[0], time[-1]), colours)
    figure.colorbar(scale, ax=axis, label="time [s]", shrink=0.8)
    return figure


def _outward_normal(point: Array) -> Array:
    """Unit normal of the face of an axis-parallel square on which a point lies."""
    axis = int(np.argmax(np.abs(point)))
    normal = np.zeros(2)
    normal[axis] = np.sign(point[axis]) or 1.0
    return normal
