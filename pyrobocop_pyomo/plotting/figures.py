"""The figure that a picture is drawn on."""

from __future__ import annotations

from typing import Any

from pyrobocop_pyomo.optional_imports import matplotlib


def figure_or_new(figure: Any, width: float, height: float) -> Any:
    """The figure or part of a figure that was given, or a new one of a size in inches.

    Made by the object interface, not pyplot: no global list of figures grows, and no display is asked for.
    """
    if figure is not None:
        return figure
    return matplotlib.figure.Figure(figsize=(width, height), layout="constrained")
