"""How variables at nodes make a motion between them.

On every interval a signal is a polynomial of the local fraction ``s`` in [0, 1], ``x(s) = sum_k w_k(s) leaf_k``: its
leaves are variables at nodes or, for schemes that start on a stage, the start value and the increments ``h f``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyrobocop_pyomo.modeling.rule_proxies import Series
from pyrobocop_pyomo.numerics import Grid
from pyrobocop_pyomo.numerics.lagrange import evaluation_matrix

Array = NDArray[np.float64]


class Interpolation(Protocol):
    """What happens on the intervals of a set of points."""

    @property
    def intervals(self) -> tuple[tuple[float, ...], ...]:
        """Nodes of each interval, both ends included."""

    def check(self, series: Series) -> None:
        """Raise `ObstacleError` for what does not move continuously."""

    def leaves(self, series: Series, interval: int) -> list[Any]:
        """Variables and expressions that make the polynomial of one interval."""

    def weights(self, series: Series, interval: int, fractions: ArrayLike) -> Array:
        """Weights of the leaves at local fractions, shape ``(len(fractions), leaves)``."""

    def is_clock_of(self, block: Any) -> bool:
        """Whether ``block.clock`` tells the time of the indices."""

    def clock(self, index: float) -> Any:
        """The time that an index stands for."""


class Source(Protocol):
    """What has a collocation grid: a phase, or a discretised continuous set."""

    @property
    def grid(self) -> Grid:
        """Scheme and mesh, in indices."""

    def check(self, series: Series) -> None:
        """Raise `ObstacleError` for what is no state."""

    def rates(self, series: Series) -> Any:
        """Derivative of a state by collocation point; None where it has none."""

    def width(self, interval: int) -> Any:
        """Width of an element in real time."""

    def clock(self, index: float) -> Any:
        """The time that an index stands for."""


class CollocationInterpolation:
    """States follow the polynomial of their scheme, the one that `Trajectory` evaluates."""

    def __init__(self, source: Source) -> None:
        self.source = source
        grid = source.grid
        starts = grid.mesh.boundaries[:-1]
        ends = grid.mesh.boundaries[1:]
        self.intervals = tuple(
            nodes if nodes[-1] == end else (*nodes, end)
            for nodes, start, end in zip(grid.node_times, starts, ends, strict=True)
        )

    def check(self, series: Series) -> None:
        """Only states are continuous."""
        self.source.check(series)

    def _rates(self, series: Series) -> Any:
        scheme = self.source.grid.scheme
        # The values at the nodes alone leave the polynomial of such a scheme one degree short.
        return self.source.rates(series) if scheme.starts_on_a_stage and scheme.is_collocation else None

    def leaves(self, series: Series, interval: int) -> list[Any]:
        """Values at the nodes, or the start value and the increments."""
        grid, rates = self.source.grid, self._rates(series)
        nodes = grid.node_times[interval]
        if rates is None:
            return [series.at(node) for node in nodes]
        width = self.source.width(interval)
        return [series.at(nodes[0]), *(width * rates[stage] for stage in grid.stage_times[interval])]

    def weights(self, series: Series, interval: int, fractions: ArrayLike) -> Array:
        """Those of the scheme."""
        scheme = self.source.grid.scheme
        if self._rates(series) is None:
            return scheme.state_at(fractions)
        increments = scheme.increments_at(fractions)
        return np.column_stack([np.ones(len(increments)), increments])

    def is_clock_of(self, block: Any) -> bool:
        """Only the phase's own."""
        return block is getattr(self.source, "phase", None)

    def clock(self, index: float) -> Any:
        """Of the phase."""
        return self.source.clock(index)


@dataclass(frozen=True, eq=False)
class NodalInterpolation:
    """Polynomials through given nodes of each interval.

    Attributes
    ----------
    intervals : tuple of tuples
        Nodes within each closed interval.
    support : tuple of tuples
        Those nodes that the polynomial goes through.
    checked : callable
        Raises `ObstacleError` for what does not move continuously.
    """

    intervals: tuple[tuple[float, ...], ...]
    support: tuple[tuple[float, ...], ...]
    checked: Any

    def check(self, series: Series) -> None:
        """As `checked` says."""
        self.checked(series)

    def leaves(self, series: Series, interval: int) -> list[Any]:
        """Values at the nodes."""
        return [series.at(node) for node in self.support[interval]]

    def weights(self, series: Series, interval: int, fractions: ArrayLike) -> Array:
        """Lagrange polynomials on the nodes."""
        start, end = self.intervals[interval][0], self.intervals[interval][-1]
        local = [(node - start) / (end - start) for node in self.support[interval]]
        return evaluation_matrix(local, fractions)

    def is_clock_of(self, block: Any) -> bool:
        """There is none."""
        return False

    def clock(self, index: float) -> Any:
        """The index is the time."""
        return index
