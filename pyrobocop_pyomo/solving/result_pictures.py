"""Results as arrays for the pictures that plotting draws."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.motion import SafetyReport
from pyrobocop_pyomo.plotting import draw_scene, plot_history, plot_pair_sides
from pyrobocop_pyomo.plotting import plot_products as plot_product_arrays
from pyrobocop_pyomo.plotting.figures import figure_or_new

from .iterates import Iterate
from .pair_report import ZERO_SIDE, PairReport


def draw_plan(
    title: str,
    scenes: Sequence[Any],
    report: SafetyReport,
    safe: bool | None,
    steps: Sequence[Iterate],
    best: int,
    figure: Any,
) -> Any:
    """The scene of each avoidance block, the clearances over time, and the runs."""
    columns = len(scenes) + 1
    figure = figure_or_new(figure, 5.6 * columns + 1.2, 7.2)
    *places, right = np.ravel(figure.subfigures(1, columns, width_ratios=[5.0] * len(scenes) + [6.0]))
    for place, (time, bodies, obstacles) in zip(places, scenes, strict=True):
        draw_scene(time, bodies, obstacles, figure=place)
    upper, lower = right.subfigures(2, 1)
    report.plot(upper)
    draw_history("", steps, best, lower)
    figure.suptitle(title if safe else f"NOT SAFE: {title}", color="0.1" if safe else "C3")
    return figure


def draw_history(title: str, steps: Sequence[Iterate], best: int, figure: Any) -> Any:
    """The runs of a result, one after the other."""
    ends = np.cumsum([float(step.iterations) for step in steps])
    starts = np.concatenate([[0.0], ends[:-1]])
    mu, delta = [], []
    for start, end, step in zip(starts, ends, steps, strict=True):
        mu.append(_line(start, end, [mu_now for mu_now, _ in step.path], step.mu))
        delta.append(_line(start, end, [delta_now for _, delta_now in step.path], step.delta))
    lines = {name: _joined(parts) for name, parts in (("delta", delta), ("mu", mu))}
    has_pairs = any(step.delta is not None for step in steps)
    dots = {
        "largest product": np.array([step.largest_product for step in steps]),
        "largest |min(first, second)|": np.array([step.largest_natural_residual for step in steps]),
    }
    return plot_history(
        title,
        ends,
        [step.label for step in steps],
        np.array([step.objective for step in steps]),
        {name: line for name, line in lines.items() if np.isfinite(line[1]).any()},
        dots if has_pairs else {},
        best,
        figure=figure,
    )


def _line(start: float, end: float, path: list[float], last: float | None) -> tuple[list[float], list[float]]:
    """One value per iteration where they are known, else the last one throughout; a gap after it."""
    if path:
        return [*np.linspace(start, end, len(path)).tolist(), end], [*path, np.nan]
    number = np.nan if last is None else last
    return [start, end, end], [number, number, np.nan]


def _joined(parts: list[tuple[list[float], list[float]]]) -> tuple[np.ndarray, np.ndarray]:
    return np.concatenate([x for x, _ in parts]), np.concatenate([y for _, y in parts])


def draw_pairs(
    title: str, pairs: Sequence[PairReport], component: str | None, axis_label: str | None, figure: Any
) -> Any:
    """Both sides of the pairs of a component, over its index where that is one number."""
    names = list(dict.fromkeys(pair.component for pair in pairs))
    if component is None and len(names) == 1:
        component = names[0]
    chosen = [pair for pair in pairs if pair.component == component]
    if not chosen:
        found = ", ".join(f"'{name}'" for name in names) or "none"
        which = "a component has to be chosen" if component is None else f"no pairs of a component '{component}'"
        raise ModelError(f"'{title}': {which}. Components with pairs: {found}.")
    place, labels = _places([pair.index for pair in chosen])
    order = np.argsort(place, kind="stable")
    return plot_pair_sides(
        f"{title}: {component}",
        place[order],
        np.array([pair.first for pair in chosen])[order],
        np.array([pair.second for pair in chosen])[order],
        zero=ZERO_SIDE,
        labels=labels,
        axis_label="index" if axis_label is None else axis_label,
        figure=figure,
    )


def _places(indices: Sequence[str]) -> tuple[np.ndarray, list[str] | None]:
    """Numbers where every index is one, else counted places with the indices as labels."""
    try:
        return np.array([float(index) for index in indices]), None
    except ValueError:
        return np.arange(1.0, len(indices) + 1), list(indices)


def draw_products(title: str, steps: Sequence[Iterate], figure: Any) -> Any:
    """Residuals of the runs that bounded products."""
    bounded = [step for step in steps if step.delta is not None and step.delta > 0.0]
    if not bounded:
        raise ModelError(f"'{title}': no run bounded products, so there is nothing to draw against delta.")
    return plot_product_arrays(
        title,
        np.array([step.delta for step in bounded], dtype=float),
        np.array([step.largest_product for step in bounded]),
        np.array([step.largest_natural_residual for step in bounded]),
        figure=figure,
    )
