"""The figure that a picture is drawn on, and one colour per time, the same in every stroboscopic picture."""

from __future__ import annotations

from functools import partial
from io import BytesIO
from typing import Any

import numpy as np

from pyrobocop_pyomo.numerics import Array, Indices
from pyrobocop_pyomo.optional_imports import matplotlib


def figure_or_new(figure: Any, width: float, height: float) -> Any:
    """The figure or part of a figure that was given, or a new one of a size in inches.

    Made by the object interface, not pyplot: no global list of figures grows, and no display is requested.
    """
    if figure is not None:
        return figure
    figure = matplotlib.figure.Figure(figsize=(width, height), layout="constrained")
    # Jupyter knows how to show figures only after pyplot was used. A partial, since figures are pickled.
    figure._repr_png_ = partial(_as_png, figure)
    return figure


def _as_png(figure: Any) -> bytes:
    """What a notebook shows of a figure at the end of a cell."""
    written = BytesIO()
    figure.savefig(written, format="png")
    return written.getvalue()


def time_colours(time: Array) -> Any:
    """A Matplotlib mappable from time to colour: ``to_rgba(t)`` gives a colour, a colorbar takes it whole."""
    # The lightest yellows of the map would vanish on white paper.
    shades = matplotlib.colormaps["viridis_r"](np.linspace(0.12, 1.0, 256))
    end = float(time[-1]) if time[-1] > time[0] else float(time[0]) + 1.0
    return matplotlib.cm.ScalarMappable(
        matplotlib.colors.Normalize(float(time[0]), end), matplotlib.colors.ListedColormap(shades)
    )


def evenly_moved(points: Array, snapshots: int) -> Indices:
    """Times to draw, with about equal motion between them, so that rest is not drawn repeatedly.

    Parameters
    ----------
    points : array, shape (T, P, 2)
        Points of the mechanism over time.
    snapshots : int
        How many times are wanted at most; the first and the last are always among them.

    Returns
    -------
    array of int
    """
    steps = np.linalg.norm(np.diff(points, axis=0), axis=-1).mean(axis=-1)
    moved = np.concatenate([[0.0], np.cumsum(steps)])
    wanted = np.linspace(0.0, moved[-1], snapshots)[1:-1]
    nearest = np.abs(moved[:, None] - wanted[None, :]).argmin(axis=0)
    return np.unique([0, *nearest, len(points) - 1])
