"""Where phases begin and end, in a figure of signals over time."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def mark_phases(figure: Any, boundaries: Array, names: Sequence[str]) -> None:
    """Shade every other phase in each panel, and write the names above the topmost panels.

    Parameters
    ----------
    figure : Figure or SubFigure
        As `plot_signals` gives it.
    boundaries : array, shape (len(names) + 1,)
        Where phases begin and end.
    names : sequence of str
    """
    spans = list(itertools.pairwise(boundaries.tolist()))
    axes = [axis for axis in figure.axes if axis.get_visible()]
    for axis in axes:
        for i, (start, end) in enumerate(spans):
            if i % 2:
                axis.axvspan(start, end, color="0.93", zorder=0, linewidth=0)
        axis.set_xlim(boundaries[0], boundaries[-1])
    top = max(axis.get_subplotspec().get_position(figure).y1 for axis in axes)
    for axis in axes:
        if abs(axis.get_subplotspec().get_position(figure).y1 - top) < 1e-9:
            for (start, end), name in zip(spans, names, strict=True):
                axis.annotate(
                    name,
                    ((start + end) / 2, 1.0),
                    xycoords=("data", "axes fraction"),
                    xytext=(0, 3),
                    textcoords="offset points",
                    ha="center",
                    fontsize="small",
                    color="0.35",
                )
