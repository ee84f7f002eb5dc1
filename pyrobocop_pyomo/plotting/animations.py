"""Bodies among obstacles as a moving picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.errors import GeometryError
from pyrobocop_pyomo.optional_imports import animation, matplotlib

from .body_path import BodyPath
from .scenes import add_polygon, check_scene, draw_path, local_polygons, scene_axis, show_window

Array = NDArray[np.float64]


def animate_scene(
    time: Array,
    bodies: Sequence[BodyPath],
    obstacles: Sequence[Any],
    path: str | Path,
    *,
    frames: int = 60,
    seconds: float | None = None,
    view: Any = None,
    title: str = "",
    unit: str = "m",
    size: tuple[float, float] = (5.0, 4.6),
) -> Path:
    """Write a GIF of bodies that move among obstacles; returns the file written.

    Parameters
    ----------
    time : array, shape (T,)
        Seconds.
    bodies, obstacles, view, title, unit
        As in `draw_scene`.
    path : str or Path
        Where to write; the suffix is made ``.gif``.
    frames : int
        Pictures, at equal distances in time; each shows the poses of the given time nearest to its own.
    seconds : float, optional
        How long the animation runs; as long as the motion, but between 2 and 10 s, by default. The last picture stays
        for another second.
    size : (width, height)
        Of the picture, inches; 100 pixels each.

    Raises
    ------
    GeometryError
        As in `draw_scene`, or when there are fewer than two frames, or no time for them.
    """
    time = np.asarray(time, dtype=float)
    check_scene(time, bodies, obstacles)
    lasts = float(np.clip(time[-1] - time[0], 2.0, 10.0)) if seconds is None else float(seconds)
    if frames < 2 or not lasts > 0:
        raise GeometryError(f"an animation of {frames} frames in {lasts:g} s; give at least 2, and a positive time.")
    figure = matplotlib.figure.Figure(figsize=size, dpi=100, layout="constrained")
    axis = scene_axis(figure, bodies, obstacles, view=view, title=title, unit=unit)
    for body in bodies:
        draw_path(axis, body, named=len(bodies) > 1)
    show_window(axis, bodies, obstacles, view)
    polygons = [local_polygons(body) for body in bodies]
    clock = axis.text2D if bodies[0].dimension == 3 else axis.text
    label = clock(0.02, 0.97, "", transform=axis.transAxes, verticalalignment="top", fontsize="small")

    target = Path(path).with_suffix(".gif")
    # Driven by hand: `FuncAnimation` redraws a first frame that nobody sees.
    writer = animation.PillowWriter(fps=frames / lasts)
    writer.setup(figure, str(target), dpi=100)
    shown: list[Any] = []
    wanted = np.linspace(time[0], time[-1], frames)
    for frame in [*wanted, *[wanted[-1]] * max(1, round(frames / lasts))]:
        i = int(np.abs(time - frame).argmin())
        for each in shown:
            each.remove()
        shown = [
            add_polygon(axis, corners, (0.13, 0.33, 0.55, 0.45), (0.13, 0.33, 0.55, 1.0), 3)
            for body, local in zip(bodies, polygons, strict=True)
            for corners in body.at(i, local)
        ]
        label.set_text(f"{frame:.2f} s")
        if frame == wanted[0]:
            # The layout is made once; made anew for every frame, the picture would tremble.
            figure.draw_without_rendering()
            figure.set_layout_engine("none")
        writer.grab_frame()
    writer.finish()
    return target
