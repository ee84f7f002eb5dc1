"""The picture of a solve: the plan among obstacles, and the history over the iterations of all runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pyrobocop_pyomo.numerics import Array

from .figures import figure_or_new
from .scenes import draw_scene
from .signals import mark_phases, show_no_noise


def plot_result(result: Any, figure: Any = None) -> Any:
    """The scene of each avoidance block of a result, the clearances over time, and the runs; else the runs alone.

    Parameters
    ----------
    result : SolveResult
    figure : Figure or SubFigure, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.figure.Figure or SubFigure
    """
    if result.safety is None:
        return plot_history(result.name, result.steps, result.best.number, figure=figure)
    scenes, is_safe = result.scenes, result.was_safe is not False
    columns = len(scenes) + 1
    figure = figure_or_new(figure, 5.6 * columns + 1.2, 7.2)
    *places, right = np.ravel(figure.subfigures(1, columns, width_ratios=[5.0] * len(scenes) + [6.0]))
    for place, (time, bodies, obstacles) in zip(places, scenes, strict=True):
        draw_scene(time, bodies, obstacles, figure=place)
    upper, lower = right.subfigures(2, 1)
    result.safety.plot(upper)
    plot_history("", result.steps, result.best.number, figure=lower)
    figure.suptitle(result.name if is_safe else f"NOT SAFE: {result.name}", color="0.1" if is_safe else "C3")
    return figure


def plot_history(title: str, steps: Sequence[Any], best: int, *, figure: Any = None) -> Any:
    """The objective above, tolerances and residuals below on a logarithmic axis; every other run is shaded.

    Runs have the numbers of `SolveResult.steps_table`.

    Parameters
    ----------
    title : str
    steps : sequence of Iterate
        The runs, one after the other.
    best : int
        Which run gave the point that was returned.
    figure : Figure or SubFigure, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.figure.Figure or SubFigure
    """
    ends = np.cumsum([float(step.iterations) for step in steps])
    starts, objective = np.concatenate([[0.0], ends[:-1]]), np.array([step.objective for step in steps])
    figure = figure_or_new(figure, 7.2, 5.4)
    upper, lower = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": (2, 3)})
    for axis in (upper, lower):
        axis.axvline(ends[best], color="0.4", linewidth=0.9, linestyle=(0, (1, 2)), zorder=1, label="returned point")
        axis.grid(alpha=0.3)
    upper.plot(ends, objective, "o-", linewidth=1, markersize=4, zorder=3)
    upper.set_ylabel("objective")
    upper.ticklabel_format(axis="y", useOffset=False)
    show_no_noise(upper, objective)
    drawn = []
    for name, place, style in (("delta", 1, "-"), ("mu", 0, "--")):  # with their places in the path of a step
        facts = ([now[place] for now in step.path] for step in steps), (getattr(step, name) for step in steps)
        iterations, values = map(np.concatenate, zip(*map(_line, starts, ends, *facts), strict=True))
        if np.isfinite(values).any():
            drawn.append((iterations, values, style, name))
    has_pairs = any(step.delta is not None for step in steps)
    if has_pairs:
        drawn.append((ends, np.array([step.largest_product for step in steps]), "o", "largest product"))
        natural = np.array([step.largest_natural_residual for step in steps])
        drawn.append((ends, natural, "s", "largest |min(first, second)|"))
    floor = _floor(np.concatenate([[1.0], *(values for _, values, *_ in drawn)]))
    for iterations, values, style, name in drawn:
        lower.plot(iterations, np.maximum(values, floor), style, linewidth=1.4, markersize=5, label=name, clip_on=False)
    lower.set_yscale("log")
    lower.set_ylim(bottom=floor)
    lower.set_ylabel("tolerances, residuals" if has_pairs else "tolerances")
    lower.set_xlabel("iteration")
    figure.legend(*lower.get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize="small")
    mark_phases(figure, np.array([0.0, *ends[:-1], max(ends[-1], 1.0)]), [str(i + 1) for i in range(len(steps))])
    if title:
        figure.suptitle(title)
    return figure


def _line(start: float, end: float, path: list[float], last: float | None) -> tuple[list[float], list[float]]:
    """One value per iteration where they are known, else the last one throughout; a gap after it."""
    if path:
        return [*np.linspace(start, end, len(path)).tolist(), end], [*path, np.nan]
    number = np.nan if last is None else last
    return [start, end, end], [number, number, np.nan]


def _floor(values: Array) -> float:
    """Where zeros are drawn on a logarithmic axis: a decade below everything else."""
    return float(10.0 ** (np.floor(np.log10(values[np.isfinite(values) & (values > 0.0)].min())) - 1))
