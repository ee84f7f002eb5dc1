"""A mesh whose elements resolve given functions of time: jumps on boundaries, oscillations and pulses within elements.

Each function is sampled once, at many instants without a period. The polynomial through its values at the points of an
element is compared with the samples within it. Elements are halved, the worst first, until the distances, integrated
over the mesh, are small parts of how far the functions depart from their means.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .arrays import Array
from .lagrange import evaluation_matrix
from .mesh import Mesh
from .schemes import Scheme

# How far functions may be from the polynomials, as a part of their distance from their means, both integrated: three
# elements for each period of a sine with three points each.
TOLERANCE = 0.03
# A function departs from its mean by at least this part of its size: a ripple below it does not count.
_RIPPLE = 0.05
# A jump is a change by this part of the range from one sample to the next, half of which is left at the same instant.
_JUMP, _LEFT = 0.05, 0.5
# How close in time the two sides of a jump are followed, as a part of the horizon.
_SAME = 2e-12
# A boundary that is so near to a jump, as a part of the element that it is in, stands for it.
_NEAR = 1e-3
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


@dataclass(frozen=True)
class Resolution:
    """What a mesh sees of functions.

    Attributes
    ----------
    mesh : Mesh
    errors : float array, shape (functions,)
        Distances from the polynomials as parts of those from the means; nan where a function is constant.
    turns : int array, shape (functions,)
        How often a function turns from rising to falling or back.
    jumps : tuple of float
        Where boundaries stand at jumps.
    """

    mesh: Mesh
    errors: Array
    turns: Array
    jumps: tuple[float, ...]

    @property
    def missed(self) -> float:
        """The largest of the errors."""
        return float(np.nan_to_num(self.errors).max(initial=0.0))


class FunctionsOfTime:
    """Functions of time, sampled between two ends.

    Parameters
    ----------
    values : callable
        From instants, shape (M,), to values, shape (functions, trials, M). Trials are the same function at other
        values of what it depends on beside the time; trials that are not finite do not count.
    start, end : float
    samples : int
    """

    def __init__(self, values: Callable[[Array], Array], start: float, end: float, samples: int) -> None:
        self._values, self._start, self._end = values, start, end
        inside = (np.arange(samples) + np.mod(np.arange(1, samples + 1) * _GOLDEN, 1.0)) / samples
        self._times = start + (end - start) * inside
        edges = np.concatenate([[start], 0.5 * (self._times[1:] + self._times[:-1]), [end]])
        self._weights = np.diff(edges) / (end - start)
        self._sampled = values(self._times)
        mean = self._sampled @ self._weights
        departure = np.abs(self._sampled - mean[..., None]) @ self._weights
        size = np.abs(self._sampled) @ self._weights
        with np.errstate(invalid="ignore"):
            self._scale = np.where(departure > 1e-12 * size, np.maximum(departure, _RIPPLE * size), np.nan)
        self._known: dict[tuple[float, float], Array] = {}

    @property
    def vary(self) -> bool:
        """Whether one of them is anything but constant."""
        return bool(np.isfinite(self._scale).any())

    def resolution(self, mesh: Mesh, scheme: Scheme, jumps: Sequence[float] = ()) -> Resolution:
        """What a mesh sees of the functions with the points of a scheme."""
        errors = self._median(self._element_errors(mesh, scheme).sum(axis=-1))
        steps = np.sign(np.diff(self._sampled, axis=-1))
        turns = np.max((steps[..., 1:] * steps[..., :-1] < 0).sum(axis=-1), axis=1)
        return Resolution(mesh, errors, turns, tuple(jumps))

    def resolving(self, mesh: Mesh, scheme: Scheme, most: int, *, most_jumps: int = 1000) -> Resolution:
        """The mesh with boundaries at jumps, and with elements halved until it resolves the functions.

        Parameters
        ----------
        mesh : Mesh
        scheme : Scheme
        most : int
            Elements, of which there are no more.
        most_jumps : int
            More places than so many are not searched for jumps.
        """
        mesh, jumps = _with_boundaries(mesh, self._jumps(scheme, min(most_jumps, most - mesh.elements)))
        while (room := most - mesh.elements) > 0:
            errors = self._largest(self._element_errors(mesh, scheme))
            if errors.sum() <= TOLERANCE:
                break
            order = np.argsort(-errors, kind="stable")
            # Those whose halves may be small enough, with all that are better left as they are.
            left = errors.sum() - np.cumsum(errors[order])
            count = min(int(np.searchsorted(-left, -0.7 * TOLERANCE)) + 1, room)
            halved = set(order[:count].tolist())
            boundaries = [mesh.boundaries[0]]
            for i, (before, after) in enumerate(pairwise(mesh.boundaries)):
                boundaries += [0.5 * (before + after), after] if i in halved else [after]
            mesh = Mesh(tuple(boundaries))
        return self.resolution(mesh, scheme, jumps)

    # ---------------------------------------------------------------- errors

    def _element_errors(self, mesh: Mesh, scheme: Scheme) -> Array:
        """Part of each element in the distance from the polynomials, shape (functions, trials, N)."""
        boundaries = np.array(mesh.boundaries)
        # One value says nothing of a function between its points: the start counts as well, a hair after a jump.
        nodes = scheme.c if scheme.stages > 1 else np.array([1e-6, max(float(scheme.c[0]), 1e-3)])
        unknown = [i for i, ends in enumerate(pairwise(boundaries)) if ends not in self._known]
        if unknown:
            starts, widths = boundaries[unknown], np.diff(boundaries)[unknown]
            at_nodes = self._values((starts[:, None] + widths[:, None] * nodes).ravel())
            at_nodes = at_nodes.reshape(*at_nodes.shape[:2], len(unknown), nodes.size)
            places = np.searchsorted(self._times, boundaries)
            for k, i in enumerate(unknown):
                some = slice(places[i], places[i + 1])
                matrix = evaluation_matrix(
                    nodes, (self._times[some] - boundaries[i]) / (boundaries[i + 1] - boundaries[i])
                )
                distances = np.abs(self._sampled[..., some] - at_nodes[..., k, :] @ matrix.T)
                self._known[boundaries[i], boundaries[i + 1]] = distances @ self._weights[some]
        errors = np.stack([self._known[ends] for ends in pairwise(boundaries)], axis=-1)
        return np.asarray(errors / self._scale[..., None])

    @staticmethod
    def _median(errors: Array) -> Array:
        """Over the trials, shape (functions, ...) of (functions, trials, ...)."""
        known = np.isfinite(errors).any(axis=1)
        middle = np.nanmedian(np.where(np.expand_dims(known, 1), errors, 0.0), axis=1)
        return np.where(known, middle, np.nan)

    def _largest(self, errors: Array) -> Array:
        """Of all functions, per element."""
        return np.asarray(np.nan_to_num(self._median(errors)).max(axis=0))

    # ---------------------------------------------------------------- jumps

    def _jumps(self, scheme: Scheme, most: int) -> list[float]:
        """Instants of jumps, on the side that the points of the scheme have to see."""
        low, high, before, after = self._times[:-1], self._times[1:], self._sampled[..., :-1], self._sampled[..., 1:]
        first = self._change(before, after)
        places = np.flatnonzero(first > _JUMP)
        if not 0 < places.size <= most:
            return []
        low, high, before, after, first = (of[..., places] for of in (low, high, before, after, first))
        while (high - low).max() > _SAME * (self._end - self._start):
            middle = 0.5 * (low + high)
            between = self._values(middle)
            left = self._change(before, between) >= self._change(between, after)
            low, before = np.where(left, low, middle), np.where(left, before, between)
            high, after = np.where(left, middle, high), np.where(left, between, after)
        jumps = self._change(before, after) > _LEFT * first
        # The element that ends at a jump has a point there, which belongs to the values before it; or one that starts.
        sides = high if scheme.starts_on_a_stage and not scheme.stiffly_accurate else low
        return [float(time) for time in sides[jumps]]

    def _change(self, before: Array, after: Array) -> Array:
        """Largest difference as a part of the range of a function, shape (M,)."""
        with np.errstate(all="ignore"):
            extent = np.ptp(self._sampled, axis=-1)
            parts = np.where(np.isfinite(self._scale)[..., None], np.abs(after - before) / extent[..., None], 0.0)
        return np.asarray(np.nan_to_num(parts).max(axis=(0, 1)))


def _with_boundaries(mesh: Mesh, wanted: Sequence[float]) -> tuple[Mesh, list[float]]:
    """A mesh with further boundaries, and those that no other is near to: all others stay where they are."""
    boundaries, kept = list(mesh.boundaries), []
    for time in wanted:
        i = int(np.searchsorted(boundaries, time))
        if not 0 < i < len(boundaries):
            continue
        least = _NEAR * (boundaries[i] - boundaries[i - 1])
        if min(time - boundaries[i - 1], boundaries[i] - time) > least:
            kept.append(time)
            boundaries.insert(i, time)
    return Mesh(tuple(boundaries)), kept


def mesh_of_delays(mesh: Mesh, delays: Sequence[float], most: int) -> Mesh:
    """A mesh that each delay moves onto itself, as far as it goes, if the given one is uniform and none is so yet.

    Where the motion has a kink it has one again a delay later; and values at earlier times are values at points then.

    Parameters
    ----------
    mesh : Mesh
    delays : sequence of float
        Positive.
    most : int
        Elements, of which there are no more; otherwise the mesh stays.
    """
    widths, start, end = mesh.widths, mesh.boundaries[0], mesh.boundaries[-1]
    horizon = end - start
    if not delays or widths.max() - widths.min() > 1e-9 * horizon:
        return mesh
    period = _common_part(delays, horizon / most)
    if period is None or period >= horizon:
        return mesh
    windows = math.floor(horizon / period + 1e-9)
    rest = horizon - windows * period
    rest = 0.0 if rest < 1e-9 * horizon else rest
    places: list[float] = []
    for left, right in ((0.0, rest), (rest, period)):
        parts = math.ceil((right - left) / float(widths.max()) - 1e-9)
        places += [left + (right - left) * k / parts for k in range(parts)]
    inner = [start + window * period + place for window in range(windows + 1) for place in places]
    boundaries = [time for time in inner if start < time < end - 1e-9 * horizon]
    made = Mesh((start, *boundaries, end))
    same = made.elements == mesh.elements and np.allclose(made.boundaries, mesh.boundaries, atol=1e-9 * horizon)
    return mesh if same or made.elements > most else made


def _common_part(delays: Sequence[float], least: float) -> float | None:
    """The largest time of which all delays are multiples; None where that is below the least."""
    found: float = delays[0]
    for delay in delays[1:]:
        one, other = found, delay
        while other > 1e-9 * found:
            one, other = other, math.fmod(one, other)
            other = 0.0 if one - other < 1e-9 * found else other
            if one < least:
                return None
        found = one
    return found if found >= least else None
