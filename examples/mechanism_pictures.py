"""Mechanisms in a plane, drawn as snapshots over time: linkages, and a slider that is pushed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle

from pyrobocop_pyomo.plotting.figures import evenly_moved, time_colours
from pyrobocop_pyomo.plotting.scenes import outline


def draw_linkage(
    time: np.ndarray,
    joints: np.ndarray,
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
    figure = figure or Figure(figsize=(6.0, 5.2), layout="constrained")
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
                Rectangle(tuple(corner), *cart, facecolor=(*colour[:3], 0.13), edgecolor=colour, zorder=2 + layer)
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


def draw_planar_pushing(
    time: np.ndarray,
    pose: np.ndarray,
    contact: np.ndarray,
    *,
    half_side: float,
    pusher_radius: float = 0.005,
    snapshots: int = 9,
    title: str = "",
    force: np.ndarray | None = None,
    obstacles: Sequence[Any] = (),
    figure: Any = None,
) -> Any:
    """Draw the slider and the pusher at several times, light to dark, with the path of the slider's centre.

    A circle marks where the centre starts, a star where it ends, a line inside the slider its x axis.

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
        How many times are drawn, with about equal motion between them.
    title : str
    force : array, shape (T, 2), optional
        Contact force in the slider's frame, newtons; drawn as arrows scaled to the slider.
    obstacles : sequence of Polytope
        What stands on the table, bounded; grey.
    figure : Figure or SubFigure, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.figure.Figure or SubFigure
    """
    figure = figure or Figure(figsize=(6.4, 6.0), layout="constrained")
    axis = figure.subplots()
    colours = time_colours(time)
    for obstacle in obstacles:
        axis.add_patch(Polygon(outline(obstacle), facecolor="0.72", edgecolor="0.45", zorder=1))
    turns = np.moveaxis(
        np.array([[np.cos(pose[:, 2]), -np.sin(pose[:, 2])], [np.sin(pose[:, 2]), np.cos(pose[:, 2])]]), -1, 0
    )
    corners = half_side * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=float)
    outlines = corners @ turns.transpose(0, 2, 1) + pose[:, None, :2]
    touching = np.einsum("tij,tj->ti", turns, contact) + pose[:, :2]
    outward = np.einsum("tij,tj->ti", turns, np.array([_outward_normal(point) for point in contact]))
    pusher = touching + pusher_radius * outward
    heading = np.einsum("tij,kj->tki", turns, half_side * np.array([[0.0, 0.0], [1.0, 0.0]])) + pose[:, None, :2]
    largest = np.abs(force).max() if force is not None and np.abs(force).max() > 0 else 1.0

    chosen = evenly_moved(np.concatenate([outlines, pusher[:, None]], axis=1), snapshots)
    for layer, i in enumerate(chosen):
        colour = colours.to_rgba(time[i])
        # Each snapshot covers the earlier ones a little: where they overlap, the eye can tell which came later.
        axis.add_patch(
            Polygon(outlines[i], facecolor=(*colour[:3], 0.13), edgecolor=colour, linewidth=1.7, zorder=2 + layer)
        )
        axis.plot(*heading[i].T, color=colour, linewidth=1.2, zorder=2 + layer)
        axis.add_patch(Circle(pusher[i], pusher_radius, color=colour, zorder=2.5 + layer))
        if force is not None and np.abs(force[i]).max() > 1e-3 * largest:
            arrow = turns[i] @ force[i] * (half_side / largest)
            axis.annotate(
                "",
                xy=touching[i],
                xytext=touching[i] - arrow,
                arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 1.4},
                zorder=2.5 + layer,
            )
    axis.plot(*pose[:, :2].T, color="black", linewidth=1.2, linestyle=(0, (4, 2)), zorder=99)
    axis.plot(*pose[0, :2], "o", color="white", markeredgecolor="black", markersize=6, zorder=100)
    axis.plot(*pose[-1, :2], "*", color="white", markeredgecolor="black", markersize=11, zorder=100)
    axis.set_aspect("equal", adjustable="datalim")  # fills its place, whatever the shape of the motion
    axis.autoscale_view()
    axis.margins(0.08)
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]")
    axis.set_title(title)
    axis.grid(alpha=0.25)
    figure.colorbar(colours, ax=axis, label="time [s]")
    return figure


def _outward_normal(point: np.ndarray) -> np.ndarray:
    """Unit normal of the face of an axis-parallel square on which a point lies."""
    axis = int(np.argmax(np.abs(point)))
    normal = np.zeros(2)
    normal[axis] = np.sign(point[axis]) or 1.0
    return normal
