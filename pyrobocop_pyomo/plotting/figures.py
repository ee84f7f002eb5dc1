"""The figure that a picture is drawn on."""

from __future__ import annotations

from functools import partial
from io import BytesIO
from typing import Any

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
