"""Data against a model: dots and lines per output."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.numerics import Array

from .figures import figure_or_new

_MOST_NAMED = 6  # data sets, beyond which a legend would hide the data


@dataclass(frozen=True, eq=False)
class FitPanel:
    """One output.

    Attributes
    ----------
    output : str
    samples : dict of data set to list of (time, measured, predicted)
        Without times (NaN), measured values are drawn over predicted ones.
    """

    output: str
    samples: dict[str, list[tuple[float, float, float]]]


def draw_fit(
    panels: Sequence[FitPanel], curves: Mapping[tuple[str, str], tuple[Array, Array]], *, figure: Any = None
) -> Any:
    """One panel per output, one colour per data set: measurements as dots, the model as a line.

    Parameters
    ----------
    panels : sequence of FitPanel
    curves : mapping of (data set, output) to (times, values)
        The model between the samples, where it is known.
    figure : Figure or SubFigure, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.figure.Figure or SubFigure
        Not shown: that is the caller's choice.
    """
    columns = 1 if len(panels) <= 4 else 2
    rows = -(-len(panels) // columns)
    figure = figure_or_new(figure, 6.0 * columns, 1.9 * rows + 0.8)
    axes = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    names = list(dict.fromkeys(name for panel in panels for name in panel.samples))
    for axis, panel in zip(axes, panels, strict=False):
        for name, samples in panel.samples.items():
            colour = f"C{names.index(name) % 10}"
            times, measured, predicted = np.array(samples).T
            if not np.isfinite(times).all():
                axis.plot(predicted, measured, ".", color=colour, label=name)
                axis.axline((float(predicted[0]), float(predicted[0])), slope=1.0, color="0.6", linewidth=1.0)
                axis.set_xlabel("predicted")
                continue
            order = np.argsort(times, kind="stable")
            line = curves.get((name, panel.output), (times[order], predicted[order]))
            axis.plot(*line, color=colour, linewidth=1.4, label=name)
            axis.plot(times, measured, ".", color=colour, markersize=4, alpha=0.6)
            axis.set_xlabel("time")
        axis.set_ylabel(panel.output)
        axis.grid(alpha=0.3)
    for axis in axes[len(panels) :]:
        axis.set_visible(False)
    if 1 < len(names) <= _MOST_NAMED:
        axes[0].legend(fontsize="small")
    return figure
