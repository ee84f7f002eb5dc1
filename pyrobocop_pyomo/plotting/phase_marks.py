"""Where phases begin and end, in a figure of signals over time."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_POINTS_PER_LETTER = 4.5  # of the small font, about


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
    places = [axis.get_subplotspec().get_position(figure) for axis in axes]
    top = max(place.y1 for place in places)
    for axis, place in zip(axes, places, strict=True):
        if top - place.y1 > 1e-9:
            continue
        points_per_second = 0.85 * place.width * figure.bbox.width * 72 / figure.dpi / (boundaries[-1] - boundaries[0])
        room = [points_per_second * (end - start) for start, end in spans]
        for (start, end), name in zip(spans, _that_fit(names, room), strict=True):
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


def _that_fit(names: Sequence[str], room: Sequence[float]) -> list[str]:
    """The names, or their indices alone where some name is wider than its phase; nothing where that is too wide too."""

    def fits(name: str, width: float) -> bool:
        return len(name) * _POINTS_PER_LETTER <= width

    indices = [name[name.index("[") + 1 : -1] if name.endswith("]") else name for name in names]
    for chosen in (list(names), indices):
        if all(fits(name, width) for name, width in zip(chosen, room, strict=True)):
            return chosen
    return [name if fits(name, width) else "" for name, width in zip(indices, room, strict=True)]
