"""The picture of a solve: its history over the iterations of all runs."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pyrobocop_pyomo.numerics import Array

from .figures import figure_or_new
from .signals import mark_phases, show_no_noise

_MOST_NAMES = 8


def plot_history(
    title: str,
    ends: Array,
    labels: Sequence[str],
    objective: Array,
    lines: Mapping[str, tuple[Array, Array]],
    dots: Mapping[str, Array],
    best: int,
    *,
    figure: Any = None,
) -> Any:
    """The objective above, tolerances and residuals below on a logarithmic axis; every other run is shaded.

    Parameters
    ----------
    title : str
    ends : array, shape (s,)
        Number of the last iteration of each run, counted through all runs.
    labels : sequence of str, length s
        What kind of runs they were.
    objective : array, shape (s,)
        At the end of each run.
    lines : mapping of name to (iterations, values)
        Drawn as lines; a NaN breaks them.
    dots : mapping of name to array, shape (s,)
        Values at the end of each run.
    best : int
        Which run gave the point that was returned.
    figure : Figure or SubFigure, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.figure.Figure or SubFigure
    """
    figure = figure_or_new(figure, 7.2, 5.4)
    upper, lower = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": (2, 3)})
    for axis in (upper, lower):
        axis.axvline(ends[best], color="0.4", linewidth=0.9, linestyle=(0, (1, 2)), zorder=1, label="returned point")
        axis.grid(alpha=0.3)
    upper.plot(ends, objective, "o-", linewidth=1, markersize=4, zorder=3)
    upper.set_ylabel("objective")
    upper.ticklabel_format(axis="y", useOffset=False)
    show_no_noise(upper, objective)
    drawn = [values for _, values in lines.values()] + list(dots.values())
    floor = _floor(np.concatenate(drawn)) if drawn else 1.0
    for (name, (iterations, values)), style in zip(lines.items(), itertools.cycle(("-", "--")), strict=False):
        lower.plot(iterations, np.maximum(values, floor), style, linewidth=1.4, label=name, zorder=2)
    for (name, values), marker in zip(dots.items(), itertools.cycle("os^D"), strict=False):
        lower.plot(ends, np.maximum(values, floor), marker, markersize=5, label=name, zorder=3, clip_on=False)
    lower.set_yscale("log")
    lower.set_ylim(bottom=floor)
    lower.set_ylabel("tolerances, residuals" if dots else "tolerances")
    lower.set_xlabel("iteration")
    figure.legend(*lower.get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize="small")
    mark_phases(figure, np.array([0.0, *ends[:-1], max(ends[-1], 1.0)]), [str(i + 1) for i in range(len(labels))])
    _name_runs(upper, labels)
    if title:
        figure.suptitle(title)
    return figure


def _floor(values: Array) -> float:
    """Where zeros are drawn on a logarithmic axis: a decade below everything else."""
    positive = values[np.isfinite(values) & (values > 0.0)]
    return float(10.0 ** (np.floor(np.log10(positive.min())) - 1)) if positive.size else 1e-16


def _name_runs(axis: Any, labels: Sequence[str]) -> None:
    """Write beside the panel which run was of which kind."""
    # Runs of one kind in a row share a line.
    in_a_row = itertools.groupby(range(len(labels)), key=lambda i: labels[i])
    grouped = [(label, [i + 1 for i in members]) for label, members in in_a_row]
    names = [f"{n[0]} {label}" if len(n) == 1 else f"{n[0]}-{n[-1]} {label}" for label, n in grouped]
    shown = names if len(names) <= _MOST_NAMES else [*names[: _MOST_NAMES - 1], f"... {len(labels)} runs"]
    beside = {"transform": axis.transAxes, "verticalalignment": "top"}
    axis.text(1.02, 1.0, "\n".join(shown), fontsize="small", color="0.35", **beside)
