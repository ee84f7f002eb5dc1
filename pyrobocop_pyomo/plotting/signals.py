"""Figures over time: signals with marks of phases, clearances, and the history of a solve."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pyrobocop_pyomo.numerics import Array

from .figures import figure_or_new
from .scenes import draw_scene

_MOST_DOTS = 120  # beyond, they merge and hide the line
_POINTS_PER_LETTER = 4.5  # of the small font, about


def plot_signals(
    title: str,
    time: Array,
    values: Mapping[str, Array],
    nodes: Mapping[str, tuple[Array, Array]],
    steps: set[str],
    *,
    labels: Mapping[str, str] | None = None,
    figure: Any = None,
) -> Any:
    """One panel per signal, the interpolation as a line, the nodes as dots where they are not too many.

    Parameters
    ----------
    title : str
    time : array, shape (m,)
        Where the interpolation was evaluated.
    values : mapping of name to array, shape (m,)
        A NaN breaks the line.
    nodes : mapping of name to (times, values)
    steps : set of str
        Names drawn as steps.
    labels : mapping of name to str, optional
        What to write beside an axis instead of the name.
    figure : Figure or SubFigure, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.figure.Figure or SubFigure
        Not shown: that is the caller's choice.
    """
    columns = 1 if len(values) <= 4 else 2
    rows = -(-len(values) // columns)
    figure = figure_or_new(figure, 4.2 * columns + 1, 1.5 * rows + 0.8)
    axes = np.atleast_1d(figure.subplots(rows, columns, sharex=True, squeeze=False)).ravel()
    for axis, name in zip(axes, values, strict=False):
        if name in steps:
            # A value belongs to the element that ends at its time, hence a step before the point.
            axis.step(time, values[name], where="pre", linewidth=1.4)
        else:
            axis.plot(time, values[name], linewidth=1.4)
            if len(nodes[name][0]) <= _MOST_DOTS:
                axis.plot(*nodes[name], ".", markersize=3, color="0.35")
        show_no_noise(axis, values[name])
        axis.set_ylabel((labels or {}).get(name, name))
        axis.grid(alpha=0.3)
    for axis in axes[len(values) :]:
        axis.set_visible(False)
    for axis in axes[max(len(values) - columns, 0) : len(values)]:
        axis.set_xlabel("time")
        axis.tick_params(labelbottom=True)
    figure.align_ylabels(axes)
    if title:
        figure.suptitle(title)
    return figure


def show_no_noise(axis: Any, values: Array) -> None:
    """A constant up to the solver's tolerance is drawn as a constant, not stretched over the panel."""
    lowest, highest = float(np.nanmin(values)), float(np.nanmax(values))
    least = max(1e-4 * max(abs(lowest), abs(highest)), 1e-6)
    if highest - lowest < least:
        middle = (lowest + highest) / 2
        half = max(0.1 * abs(middle), least)
        axis.set_ylim(middle - half, middle + half)


def mark_phases(figure: Any, boundaries: Array, names: Sequence[str]) -> None:
    """Shade every other phase, or run of a solve, in each panel, and write the names above the topmost panels.

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
        for (start, end), name in zip(spans, names, strict=True):
            # The name, or only its index where it is wider than its phase, or nothing where the index is too wide.
            most = points_per_second * (end - start) / _POINTS_PER_LETTER
            index = name[name.index("[") + 1 : -1] if name.endswith("]") else name
            shown = next((text for text in (name, index) if len(text) <= most), "")
            above = {"transform": axis.get_xaxis_transform(), "horizontalalignment": "center"}
            axis.text((start + end) / 2, 1.03, shown, fontsize="small", color="0.35", **above)


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


def plot_clearances(title: str, pairs: Sequence[Any], *, most: int = 6, figure: Any = None) -> Any:
    """Draw one line per body pair for what is proven, dots for what was measured, a dashed line for what is required.

    Parameters
    ----------
    title : str
    pairs : sequence of BodyPairSafety
        Those with least to spare first.
    most : int
        How many get a line of their own; the smallest values of the others are one grey line.
    figure : Figure or SubFigure, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.figure.Figure or SubFigure
    """
    figure = figure_or_new(figure, 7.2, 4.0)
    axis = figure.subplots()
    axis.set_title(title, color="0.1" if all(pair.safe is not False for pair in pairs) else "C3")
    drawn, rest = pairs[:most], pairs[most:]
    for i, pair in enumerate(drawn):
        colour, names = f"C{i}", f"{pair.first} - {pair.second}"
        _steps(axis, pair.interval_ends, pair.proven_of_both, color=colour, linewidth=1.6, label=names)
        axis.plot(pair.interval_times, pair.interval_distance, "o", color=colour, markersize=3, zorder=3)
    for pair in rest:
        label = f"{len(rest)} others" if pair is rest[0] else None
        _steps(axis, pair.interval_ends, pair.proven_of_both, color="0.75", linewidth=0.8, zorder=1, label=label)
    for pair in drawn:
        label = "asked" if pair is drawn[0] else None
        dashed = {"linewidth": 1.2, "linestyle": (0, (5, 3)), "zorder": 4}
        _steps(axis, pair.interval_ends, pair.interval_clearance, color="black", label=label, **dashed)
    axis.axhline(0.0, color="C3", linewidth=0.8, zorder=1)
    axis.axhspan(-1e9, 0.0, color="C3", alpha=0.06, linewidth=0)
    axis.set_ylim(*_limits(drawn))
    axis.set_xlabel("time")
    axis.set_ylabel("distance: line proven, dot found")
    axis.grid(alpha=0.3)
    if pairs:
        axis.margins(x=0.01)
        figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize="small")
    return figure


def _steps(axis: Any, spans: Array, values: Array, **style: Any) -> None:
    """A level per interval, with a gap where the next one does not follow, or where nothing is known."""
    breaks = 1 + np.flatnonzero(spans[1:, 0] != spans[:-1, 1])
    times = np.insert(spans.ravel(), 2 * breaks, spans[breaks - 1, 1])
    levels = np.repeat(np.where(np.isfinite(values), values, np.nan), 2)
    axis.plot(times, np.insert(levels, 2 * breaks, np.nan), **style)


def _limits(pairs: Sequence[Any]) -> tuple[float, float]:
    """From below the smallest distance to some times the clearance, or to the largest distance if that is less."""
    asked = max((float(pair.interval_clearance.max(initial=0.0)) for pair in pairs), default=1.0)
    levels = [values for pair in pairs for values in (pair.proven_of_both, pair.interval_distance)]
    known = [values[np.isfinite(values)] for values in levels]
    joined = np.concatenate([*known, [asked]])
    # The pair with most to spare of those drawn is to be seen at its closest.
    closest = max((float(values.min()) for values in known if values.size), default=asked)
    # Larger distances are off the picture: what counts is near the line that is requested.
    high = min(float(joined.max()), max(8.0 * asked, 1.5 * closest))
    low = min(0.0, float(joined.min()))
    return low - 0.05 * (high - low), high + 0.1 * (high - low)
