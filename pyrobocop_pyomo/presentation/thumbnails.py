"""Small pictures in SVG, in the colour of the text around them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from .html import Html

# More corners than a few pixels can show only make a notebook large.
MOST_POINTS = 120


def sparkline(times: ArrayLike, values: ArrayLike, *, steps: bool = False, width: int = 120, height: int = 24) -> Html:
    """A curve over time without axes, from its smallest to its largest value.

    Parameters
    ----------
    times, values : array, shape (T,)
        Values that are not finite interrupt nothing: they are left out.
    steps : bool
        Draw each value as constant since the time before it.
    width, height : int
        Pixels.
    """
    t, y = np.asarray(times, dtype=float), np.asarray(values, dtype=float)
    known = np.isfinite(t) & np.isfinite(y)
    t, y = t[known], y[known]
    if len(t) > MOST_POINTS:
        kept = np.unique(np.linspace(0, len(t) - 1, MOST_POINTS).round().astype(int))
        t, y = t[kept], y[kept]
    if steps:
        t, y = np.repeat(t, 2)[:-1], np.repeat(y, 2)[1:]
    if not len(t):
        return Html("")
    x, y = _within(t, 2.0, width - 2.0), _within(-y, 2.0, height - 2.0)
    return Html(
        f'<svg width="{width}" height="{height}" role="img" aria-label="curve over time">'
        f'<polyline fill="none" stroke="currentColor" stroke-width="1.3" points="{_points(x, y)}"/></svg>'
    )


def outline_picture(outlines: Sequence[ArrayLike], radii: Sequence[float] | None = None, *, size: int = 120) -> Html:
    """Polygons in the plane, filled lightly, at equal scales of both axes.

    Parameters
    ----------
    outlines : sequence of array, shape (n, 2)
        Corners of each, in order; a point or a segment as well.
    radii : sequence of float, optional
        By how much each is padded, with round corners.
    size : int
        Pixels of the longer side.
    """
    corners = [np.asarray(outline, dtype=float).reshape(-1, 2) for outline in outlines]
    padding = [0.0] * len(corners) if radii is None else [float(radius) for radius in radii]
    if not corners:
        return Html("")
    low = np.min([points.min(axis=0) - radius for points, radius in zip(corners, padding, strict=True)], axis=0)
    high = np.max([points.max(axis=0) + radius for points, radius in zip(corners, padding, strict=True)], axis=0)
    scale = (size - 6.0) / max(float((high - low).max()), 1e-12)
    width, height = ((high - low) * scale + 6.0).round(1)
    shapes = []
    for points, radius in zip(corners, padding, strict=True):
        x, y = 3.0 + (points[:, 0] - low[0]) * scale, 3.0 + (high[1] - points[:, 1]) * scale
        if radius > 0.0:  # a wide line with round joins, of which the outline is the middle
            shapes.append(
                f'<polygon points="{_points(x, y)}" fill="currentColor" stroke="currentColor" opacity="0.2" '
                f'stroke-linejoin="round" stroke-linecap="round" stroke-width="{2.0 * radius * scale:.1f}"/>'
            )
        shapes.append(
            f'<polygon points="{_points(x, y)}" fill="currentColor" fill-opacity="0.12" stroke="currentColor" '
            'stroke-width="1.2" stroke-linejoin="round"/>'
        )
    return Html(f'<svg width="{width:g}" height="{height:g}" role="img" aria-label="outline">{"".join(shapes)}</svg>')


def path_picture(places: ArrayLike, *, size: int = 120) -> Html:
    """A path in the plane, with a dot at its start, at equal scales of both axes; `places` has the shape (n, 2)."""
    points = np.asarray(places, dtype=float).reshape(-1, 2)
    points = points[np.unique(np.linspace(0, len(points) - 1, min(MOST_POINTS, len(points))).round().astype(int))]
    low, high = points.min(axis=0), points.max(axis=0)
    scale = (size - 8.0) / max(float((high - low).max()), 1e-12)
    width, height = ((high - low) * scale + 8.0).round(1)
    x, y = 4.0 + (points[:, 0] - low[0]) * scale, 4.0 + (high[1] - points[:, 1]) * scale
    return Html(
        f'<svg width="{width:g}" height="{height:g}" role="img" aria-label="path">'
        f'<polyline fill="none" stroke="currentColor" stroke-width="1.3" points="{_points(x, y)}"/>'
        f'<circle cx="{x[0]:.1f}" cy="{y[0]:.1f}" r="3" fill="currentColor"/></svg>'
    )


def _within(values: np.ndarray, low: float, high: float) -> np.ndarray:
    span = float(np.ptp(values))
    # A constant, up to rounding, is a line in the middle.
    if span <= 1e-12 * max(1.0, float(np.abs(values).max())):
        return np.full(len(values), 0.5 * (low + high))
    return low + (values - values.min()) * ((high - low) / span)


def _points(x: np.ndarray, y: np.ndarray) -> str:
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
