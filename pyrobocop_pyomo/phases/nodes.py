"""Where the values of a declared name live on a grid, and what they mean at any other time.

States live at element boundaries and collocation points, algebraics and collocated controls at collocation points.
A piecewise control has fewer values: one per interval between its knots, or one per knot. A declaration says which
(`Declaration.nodes`); everything that reads, writes or evaluates values asks the nodes.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pyomo.core.base.set import RangeSet

from pyrobocop_pyomo.errors import InitialGuessError, ModelError
from pyrobocop_pyomo.modeling.rule_slips import number_at
from pyrobocop_pyomo.numerics import Array, Grid

InitialGuess = Union[float, Sequence[float], NDArray[np.float64], Callable[[float], float], None]  # noqa: UP007
Weights = list[tuple[int, float]]


@dataclass(frozen=True)
class Nodes:
    """Where the values of one name live.

    Attributes
    ----------
    component : str
        Name of the component that holds the variables, one for each of `times`.
    grid : Grid
        In the phase's time indices.
    """

    component: str
    grid: Grid

    @property
    def times(self) -> tuple[float, ...]:
        """Time index of each value."""
        return self.grid.points

    @property
    def sample_times(self) -> tuple[float, ...]:
        """Where a signal is sampled whose values are wanted; see `from_samples`."""
        return self.times

    @property
    def begins(self) -> NDArray[np.bool_] | None:
        """Which samples are wanted just after their time; None for no one."""
        return None

    @property
    def starts_elements(self) -> bool:
        """Whether a stage at an element boundary belongs to the element that begins there, as of explicit Euler."""
        return self.grid.scheme.starts_on_a_stage and not self.grid.elements_share_points

    @cached_property
    def of_points(self) -> NDArray[np.int64]:
        """Number of the value that holds at each collocation point."""
        return np.arange(len(self.grid.points))

    @property
    def steps_at_points(self) -> NDArray[np.int64]:
        """Which difference of neighbouring values is the rate of change seen at each collocation point: the last."""
        return self.of_points - 1

    @property
    def indices(self) -> Sequence[Any]:
        """Of the component: one for each of `times`."""
        return self.times

    def index_set(self, block: Any) -> Any:
        """Index set of the component."""
        return block.points

    def variables(self, block: Any) -> list[Any]:
        """The variables, in the order of `times`."""
        component, indices = block.component(self.component), self.indices
        # Pyomo's own order is that of the times, and is read many times faster than one after the other.
        return [*component.values()] if len(component) == len(indices) else [component[index] for index in indices]

    def variable(self, block: Any, position: int) -> Any:
        """One of the variables."""
        return block.component(self.component)[self.indices[position]]

    def from_samples(self, samples: Array) -> Array:
        """Values from samples at `sample_times`."""
        return samples

    def from_guess(self, guess: InitialGuess, label: str) -> Array:
        """Values that an initial guess of the user's means.

        Raises
        ------
        InitialGuessError
            When it has the wrong length, or is not finite.
        """
        raise NotImplementedError

    def weights_at(self, time: float, after: bool = False) -> Weights:
        """Which values make the value at a time index, and their weights.

        Parameters
        ----------
        time : float
        after : bool
            At an element boundary, ask the element that starts there; by default the one that ends.
        """
        raise NotImplementedError

    def at_points(self, values: Array) -> Array:
        """Values at the collocation points."""
        return values[self.of_points]

    def _element(self, time: float, after: bool) -> tuple[int, float]:
        """The element that answers for a time, and where in it the time lies, from 0 to 1."""
        mesh = self.grid.mesh
        found = (bisect_right if after else bisect_left)(mesh.boundaries, time) - 1
        i = min(max(found, 0), mesh.elements - 1)
        return i, min(max((time - mesh.boundaries[i]) / float(mesh.widths[i]), 0.0), 1.0)


@dataclass(frozen=True)
class StateNodes(Nodes):
    """Element boundaries and collocation points."""

    @property
    def times(self) -> tuple[float, ...]:
        """Time index of each value."""
        return self.grid.times

    def index_set(self, block: Any) -> Any:
        """Index set of the component."""
        return block.time

    def from_guess(self, guess: InitialGuess, label: str) -> Array:
        """As declared; an array has one value per time, or one per element boundary, which lines join."""
        boundaries, times = self.grid.mesh.boundaries, self.times
        lengths = {len(times), len(boundaries)}
        values = _guessed(guess, times, lengths, label, f"{len(boundaries)} element boundaries")
        return values if len(values) == len(times) else np.interp(times, boundaries, values)

    def weights_at(self, time: float, after: bool = False) -> Weights:
        """By the polynomial of the element."""
        element, local = self._element(time, after)
        return _nonzero(self.grid.node_positions[element], self.grid.scheme.state_at([local])[0])

    @cached_property
    def of_points(self) -> NDArray[np.int64]:
        """The value at each collocation point."""
        return np.searchsorted(self.times, self.grid.points)


@dataclass(frozen=True)
class StageNodes(Nodes):
    """Collocation points."""

    @property
    def begins(self) -> NDArray[np.bool_] | None:
        """A stage at an element start that no other element shares belongs to the element that begins."""
        if not self.starts_elements:
            return None
        return np.isin(self.grid.points, [times[0] for times in self.grid.stage_times])

    def from_guess(self, guess: InitialGuess, label: str) -> Array:
        """As declared; an array has one value per point, or one per element."""
        elements, points = self.grid.mesh.elements, self.grid.points
        values = _guessed(guess, points, {len(points), elements}, label, f"{elements} elements")
        return values if len(values) == len(points) else values[[self.grid.element_of[time] for time in points]]

    def weights_at(self, time: float, after: bool = False) -> Weights:
        """By the polynomial through the stages of the element."""
        element, local = self._element(time, after)
        return _nonzero(self.grid.stage_positions[element], self.grid.scheme.stage_polynomial_at([local])[0])


@dataclass(frozen=True)
class _PiecewiseNodes(Nodes):
    """Of a piecewise control.

    Attributes
    ----------
    knots : tuple of float
        Element boundaries, the first and the last among them.
    """

    knots: tuple[float, ...]

    @property
    def indices(self) -> Sequence[Any]:
        """Of the component: the intervals or the knots are numbered."""
        return range(len(self.times))

    def index_set(self, block: Any) -> Any:
        """Index set of the component."""
        return RangeSet(0, len(self.times) - 1)

    @cached_property
    def of_elements(self) -> NDArray[np.int64]:
        """The interval between knots of each element."""
        return np.searchsorted(self.knots, _middles(self.grid.mesh.boundaries)) - 1

    @cached_property
    def of_points(self) -> NDArray[np.int64]:
        """The interval between knots of each collocation point."""
        return self.of_elements[[self.grid.element_of[time] for time in self.grid.points]]


class IntervalNodes(_PiecewiseNodes):
    """Intervals between knots, over each of which a value is constant."""

    @property
    def times(self) -> tuple[float, ...]:
        """The middle of each interval."""
        return _middles(self.knots)

    @property
    def sample_times(self) -> tuple[float, ...]:
        """The middle of each element."""
        return _middles(self.grid.mesh.boundaries)

    def from_samples(self, samples: Array) -> Array:
        """The mean over the elements of each interval, weighted by their widths."""
        widths, count = self.grid.mesh.widths, len(self.knots) - 1
        total = np.bincount(self.of_elements, widths * samples, count)
        return total / np.bincount(self.of_elements, widths, count)

    def from_guess(self, guess: InitialGuess, label: str) -> Array:
        """Values that an initial guess of the user's means: an array has one value per interval, or per element."""
        intervals, elements = len(self.knots) - 1, self.grid.mesh.elements
        if not callable(guess) and np.ndim(guess) == 1 and len(guess) == intervals:  # type: ignore[arg-type]
            return _guessed(guess, self.times, {intervals}, label, f"{intervals} intervals")
        return self.from_samples(_guessed(guess, self.sample_times, {elements}, label, f"{elements} elements"))

    def weights_at(self, time: float, after: bool = False) -> Weights:
        """The value of the interval."""
        element, _ = self._element(time, after)
        return [(int(self.of_elements[element]), 1.0)]


class KnotNodes(_PiecewiseNodes):
    """Knots, between which values are joined by lines."""

    @property
    def times(self) -> tuple[float, ...]:
        """The knots."""
        return self.knots

    @property
    def steps_at_points(self) -> NDArray[np.int64]:
        """The step that is going on."""
        return self.of_points

    def from_guess(self, guess: InitialGuess, label: str) -> Array:
        """Values that an initial guess of the user's means."""
        return _guessed(guess, self.knots, {len(self.knots)}, label, f"{len(self.knots)} knots")

    def weights_at(self, time: float, after: bool = False) -> Weights:
        """By the line between two knots."""
        i = self._interval(time)
        share = min(max((time - self.knots[i]) / (self.knots[i + 1] - self.knots[i]), 0.0), 1.0)
        return [(i + k, weight) for k, weight in enumerate((1.0 - share, share)) if weight != 0.0]

    def at_points(self, values: Array) -> Array:
        """Values at the collocation points."""
        return np.interp(self.grid.points, self.knots, values)

    def _interval(self, time: float) -> int:
        return min(max(bisect_left(self.knots, time) - 1, 0), len(self.knots) - 2)


def knots_on_mesh(knots: tuple[float, ...] | None, grid: Grid, label: str) -> tuple[float, ...]:
    """The knots of a piecewise control: element boundaries, all of them or those that the user chose.

    Raises
    ------
    ModelError
        When a knot is no element boundary, or the ends are missing.
    """
    boundaries = grid.mesh.boundaries
    if knots is None:
        return boundaries
    slack = 1e-9 * (boundaries[-1] - boundaries[0])
    found = []
    for knot in knots:
        nearest = min(boundaries, key=lambda boundary: abs(boundary - knot))
        if abs(nearest - knot) > slack:
            raise ModelError(
                f"{label}: knot {knot:g} is no element boundary; the nearest is {nearest:g}. The mesh is too coarse "
                "for it: give mesh= with this boundary, or move the knot."
            )
        found.append(nearest)
    if (found[:1], found[-1:]) != ([boundaries[0]], [boundaries[-1]]) or any(a >= b for a, b in pairwise(found)):
        raise ModelError(
            f"{label}: knots {knots} must increase from {boundaries[0]:g} to {boundaries[-1]:g}, both included."
        )
    return tuple(found)


def _middles(times: tuple[float, ...]) -> tuple[float, ...]:
    return tuple((start + end) / 2 for start, end in pairwise(times))


def _nonzero(positions: ArrayLike, weights: Array) -> Weights:
    return [(int(i), weight) for i, weight in zip(positions, weights.tolist(), strict=True) if weight != 0.0]  # type: ignore[arg-type]


def initial_number(guess: InitialGuess, label: str) -> float:
    """A single number, for what does not change in time.

    Raises
    ------
    InitialGuessError
        When it is no finite number.
    """
    if callable(guess):
        raise InitialGuessError(f"{label}: the initial guess is a function of time, but '{label}' is one number.")
    return float(_guessed(guess, (0.0,), {1}, label, "one number")[0])


def _guessed(guess: InitialGuess, times: Sequence[float], lengths: set[int], label: str, expected: str) -> Array:
    try:
        if guess is None:
            values = np.zeros(len(times))
        elif callable(guess):
            what = f"{label}: the initial guess"
            values = np.array([float(number_at(guess, time, what, InitialGuessError)) for time in times])
        else:
            if np.asarray(guess).dtype.kind in "SU":
                raise TypeError("it is text")  # NumPy would read the number out of it
            values = np.asarray(guess, dtype=float)
    except (TypeError, ValueError) as error:
        raise InitialGuessError(f"{label}: the initial guess is not made of numbers ({error}).") from error
    if values.ndim == 0:
        values = np.full(len(times), float(values))
    if values.ndim != 1 or len(values) not in lengths:
        shape = f"{len(values)} values" if values.ndim == 1 else f"shape {values.shape}"
        needed = " or ".join(str(length) for length in sorted(lengths))
        raise InitialGuessError(
            f"{label}: the initial guess has {shape}; {expected} need {needed}. Give {needed} values, a number, "
            "or a function of time."
        )
    if not np.isfinite(values).all():
        i = int(np.flatnonzero(~np.isfinite(values))[0])
        raise InitialGuessError(
            f"{label}: value {i} of the initial guess is {values[i]}; initial guesses must be finite."
        )
    return values
