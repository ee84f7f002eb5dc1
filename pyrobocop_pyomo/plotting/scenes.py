"""Bodies among obstacles, drawn as snapshots over time, in the plane and in space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.errors import GeometryError
from pyrobocop_pyomo.optional_imports import art3d, matplotlib

from .body_path import BodyPath
from .outlines import faces, outline
from .time_colours import evenly_moved, time_colours

Array = NDArray[np.float64]


def draw_scene(
    time: Array,
    bodies: Sequence[BodyPath],
    obstacles: Sequence[Any] = (),
    *,
    snapshots: int = 12,
    view: Any = None,
    title: str = "",
    unit: str = "m",
    figure: Any = None,
) -> Any:
    """Draw bodies at several times, light to dark, among obstacles in grey.

    The same colour means the same time for every body. A dashed line is the path of a body's reference point, a circle
    marks where it starts, a star where it ends.

    Parameters
    ----------
    time : array, shape (T,)
        Seconds.
    bodies : sequence of BodyPath
        With a pose for each time.
    obstacles : sequence of Polytope
        What stands still; padded ones have round corners, those with rays end at the edge of the picture.
    snapshots : int
        How many times are drawn, with about equal motion between them.
    view : (lower, upper), optional
        Corners of what is shown, shape (2, d). By default all motion is seen, and what is near it.
    title : str
    unit : str
        Of lengths, written on the axes.
    figure : Figure or SubFigure, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.figure.Figure or SubFigure

    Raises
    ------
    GeometryError
        When there is no body, bodies or obstacles differ in dimension, or the number of poses is not that of times.
    """
    time = np.asarray(time, dtype=float)
    dimension = check_scene(time, bodies, obstacles)
    if figure is None:
        figure = matplotlib.figure.Figure(figsize=(6.4, 6.0), layout="constrained")
    axis = scene_axis(figure, bodies, obstacles, view=view, title=title, unit=unit)
    colours = time_colours(time)
    chosen = evenly_moved(np.concatenate([body.places() for body in bodies], axis=1), snapshots)
    for body in bodies:
        draw_path(axis, body, named=len(bodies) > 1)
        local = local_polygons(body)
        for layer, i in enumerate(chosen.tolist()):
            colour = colours.to_rgba(time[i])
            for polygon in body.at(i, local):
                # Each snapshot covers the earlier ones a little: where they overlap, the eye can tell which came later.
                add_polygon(axis, polygon, (*colour[:3], 0.13), colour, 2 + 0.01 * layer)
    show_window(axis, bodies, obstacles, view)
    figure.colorbar(colours, ax=axis, label="time [s]", **({"shrink": 0.6, "pad": 0.12} if dimension == 3 else {}))
    return figure


def check_scene(time: Array, bodies: Sequence[BodyPath], obstacles: Sequence[Any]) -> int:
    """The dimension of a scene, after checking that its parts fit together."""
    if not bodies:
        raise GeometryError("a scene without a body: nothing would move. Give at least one BodyPath.")
    dimension = bodies[0].dimension
    for each in (*bodies, *obstacles):
        if each.dimension != dimension:
            raise GeometryError(
                f"'{each.name}' has dimension {each.dimension} and '{bodies[0].name}' has {dimension}: a scene is "
                "either planar or spatial."
            )
    for body in bodies:
        if len(body.translation) != len(time):
            raise GeometryError(f"body '{body.name}' has {len(body.translation)} poses at {len(time)} times.")
    return dimension


def scene_axis(
    figure: Any, bodies: Sequence[BodyPath], obstacles: Sequence[Any], *, view: Any, title: str, unit: str
) -> Any:
    """Axes with the obstacles drawn; `show_window` then sets their limits."""
    dimension = bodies[0].dimension
    window = _window(bodies, obstacles) if view is None else np.asarray(view, dtype=float)
    if dimension == 3:
        axis = figure.subplots(subplot_kw={"projection": "3d"})
        for obstacle in obstacles:
            edge = (0.4, 0.4, 0.4, 0.1 if obstacle.radius else 0.8)  # the facets of what is round are not meant
            for polygon in faces(obstacle, window):
                add_polygon(axis, polygon, (0.55, 0.55, 0.55, 0.35), edge, 1)
        axis.set_zlabel(f"z [{unit}]")
        axis.set_box_aspect(window[1] - window[0])
    else:
        axis = figure.subplots()
        # Axes that fill their place, whatever the shape of the motion, may show more than the window.
        shown = window if view is not None else window + (window[1] - window[0]).max() * np.array([[-3.0], [3.0]])
        for obstacle in obstacles:
            corners = outline(obstacle, shown)
            if len(corners):
                add_polygon(axis, corners, (0.72, 0.72, 0.72, 1.0), (0.45, 0.45, 0.45, 1.0), 1)
        axis.set_aspect("equal", adjustable="datalim" if view is None else "box")
        axis.grid(alpha=0.25)
        axis.set_axisbelow(True)
    axis.set_xlabel(f"x [{unit}]")
    axis.set_ylabel(f"y [{unit}]")
    axis.set_title(title)
    return axis


def show_window(axis: Any, bodies: Sequence[BodyPath], obstacles: Sequence[Any], view: Any) -> None:
    """Set the limits, once everything is drawn."""
    window = _window(bodies, obstacles) if view is None else np.asarray(view, dtype=float)
    # Where Matplotlib may fit the limits to the shape of the axes, it complains about limits that are fixed.
    free = view is None and bodies[0].dimension == 2
    axis.set_xlim(*window[:, 0], auto=free)
    axis.set_ylim(*window[:, 1], auto=free)
    if bodies[0].dimension == 3:
        axis.set_zlim(*window[:, 2])


def local_polygons(body: BodyPath) -> list[Array]:
    """What is drawn of a body, in its own frame."""
    if body.dimension == 3:
        return [polygon for part in body.parts for polygon in faces(part)]  # type: ignore[union-attr]
    return [outline(part) for part in body.parts]  # type: ignore[union-attr]


def add_polygon(axis: Any, corners: Array, face: Any, edge: Any, layer: float) -> Any:
    """One polygon onto an axis of either kind; a point becomes a dot."""
    width = 0.8 if corners.shape[1] == 3 else 1.4
    if len(corners) == 1:
        return axis.plot(*corners.T, "o", color=edge, markersize=4, zorder=layer)[0]
    if corners.shape[1] == 3:
        patch = art3d.Poly3DCollection([corners], facecolor=face, edgecolor=edge, linewidth=width, zorder=layer)
        return axis.add_collection3d(patch)
    patch = matplotlib.patches.Polygon(corners, facecolor=face, edgecolor=edge, linewidth=width, zorder=layer)
    return axis.add_patch(patch)


def draw_path(axis: Any, body: BodyPath, *, named: bool) -> None:
    """The path of the reference point, with a circle at its start and a star at its end."""
    path = body.translation
    axis.plot(*path.T, color="black", linewidth=1.2, linestyle=(0, (4, 2)), zorder=99)
    axis.plot(*path[:1].T, "o", color="white", markeredgecolor="black", markersize=6, zorder=100)
    axis.plot(*path[-1:].T, "*", color="white", markeredgecolor="black", markersize=11, zorder=100)
    if named:
        axis.text(*path[0], f"  {body.name}", fontsize="small", zorder=101)


def _window(bodies: Sequence[BodyPath], obstacles: Sequence[Any]) -> Array:
    """What a scene needs to be seen: all motion, with room around it, and obstacles as far as they are near.

    A wall that is much longer than the motion would make a dot of it: the picture ends at half as much again.
    """
    reach = max(float(part.radius) for body in bodies for part in body.parts)  # type: ignore[union-attr]
    places = np.concatenate([body.places().reshape(-1, body.dimension) for body in bodies])
    lower, upper = places.min(axis=0) - reach, places.max(axis=0) + reach
    room = 0.5 * max(float((upper - lower).max()), 1e-9)
    low, high = lower - 0.08 * room, upper + 0.08 * room
    for obstacle in obstacles:
        corners = np.asarray(obstacle.vertices, dtype=float)
        # So that an endless wall at the edge of the picture is seen as a wall and not as a line.
        rays = np.concatenate([np.zeros((1, len(lower))), np.reshape(obstacle.rays, (-1, len(lower)))])
        before = corners.min(axis=0) - obstacle.radius - room * np.where(rays.min(axis=0) < -1e-9, 0.3, 0.08)
        after = corners.max(axis=0) + obstacle.radius + room * np.where(rays.max(axis=0) > 1e-9, 0.3, 0.08)
        low = np.minimum(low, np.maximum(before, lower - 0.5 * room))
        high = np.maximum(high, np.minimum(after, upper + 0.5 * room))
    return np.array([low, high])
