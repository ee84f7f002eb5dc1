"""Results as arrays for the pictures that plotting draws."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pyrobocop_pyomo.plotting import draw_scene, plot_history
from pyrobocop_pyomo.plotting.figures import figure_or_new

from .iterates import Iterate


def draw_plan(result: Any, figure: Any) -> Any:
    """The scene of each avoidance block of a result, the clearances over time, and the runs."""
    title, scenes, is_safe = result.name, result.scenes, result.was_safe is not False
    columns = len(scenes) + 1
    figure = figure_or_new(figure, 5.6 * columns + 1.2, 7.2)
    *places, right = np.ravel(figure.subfigures(1, columns, width_ratios=[5.0] * len(scenes) + [6.0]))
    for place, (time, bodies, obstacles) in zip(places, scenes, strict=True):
        draw_scene(time, bodies, obstacles, figure=place)
    upper, lower = right.subfigures(2, 1)
    result.safety.plot(upper)
    draw_history("", result.steps, result.best_step, lower)
    figure.suptitle(title if is_safe else f"NOT SAFE: {title}", color="0.1" if is_safe else "C3")
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
