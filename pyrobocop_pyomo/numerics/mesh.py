"""A mesh of elements, and the grid of times that a scheme lays on it. Boundaries are never rounded.

From the errors of elements to a better mesh: split where they are large, join where they are small.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.presentation import Presented

from .arrays import Array, Indices, increasing_numbers
from .rounding import NEGLIGIBLE, ROUNDING
from .schemes import Scheme


@dataclass(frozen=True)
class Mesh(Presented):
    """Element boundaries ``t_0 < t_1 < ... < t_N``.

    Attributes
    ----------
    boundaries : tuple of float, length N + 1
        Exactly as given; nothing is rounded.

    Raises
    ------
    ModelError
        With fewer than two boundaries, values that are not finite, or boundaries that do not increase.
    """

    boundaries: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.boundaries) < 2:
            elements = max(len(self.boundaries) - 1, 0)
            raise ModelError(f"a mesh of {elements} elements; at least one element, hence two boundaries, is needed.")
        increasing_numbers(self.boundaries, "mesh boundaries", ModelError)

    @classmethod
    def uniform(cls, start: float, end: float, elements: int) -> Mesh:
        """``elements`` elements of equal width between ``start`` and ``end``."""
        if isinstance(elements, bool) or not isinstance(elements, (int, np.integer)) or elements < 1:
            raise ModelError(f"elements = {elements!r}; expected an integer of at least 1.")
        # Multiply before dividing: 10 * 3 / 100 is 0.3, where 3 * (10 / 100) is not.
        inner = [start + (end - start) * i / elements for i in range(elements)]
        return cls((*inner, float(end)))

    @classmethod
    def given(cls, boundaries: Sequence[float]) -> Mesh:
        """A mesh on the user's own boundaries."""
        return cls(tuple(float(value) for value in boundaries))

    @property
    def elements(self) -> int:
        """Number of elements."""
        return len(self.boundaries) - 1

    @cached_property
    def widths(self) -> Array:
        """Width of each element, shape ``(N,)``."""
        return np.diff(np.asarray(self.boundaries))

    def _summary(self) -> str:
        start, end = self.boundaries[0], self.boundaries[-1]
        widths = f"{min(self.widths):.4g} .. {max(self.widths):.4g}"
        return f"{self.elements} elements from {start:g} to {end:g}, widths {widths}"


@dataclass(frozen=True)
class Grid(Presented):
    """The times of a scheme on a mesh.

    Attributes
    ----------
    scheme : Scheme
    mesh : Mesh
    """

    scheme: Scheme
    mesh: Mesh

    def __deepcopy__(self, memo: dict[int, object]) -> Grid:
        return self  # nothing in it can change, so that cloned models share it

    @cached_property
    def stage_times(self) -> tuple[tuple[float, ...], ...]:
        """Times of the stages of each element, ``N`` tuples of ``s``."""
        return self._times_of(self.scheme.c)

    @cached_property
    def node_times(self) -> tuple[tuple[float, ...], ...]:
        """Times of the state's nodes of each element, the element start first."""
        return self._times_of(self.scheme.state_nodes)

    def _times_of(self, local: Array) -> tuple[tuple[float, ...], ...]:
        rows = []
        for i, width in enumerate(self.mesh.widths):
            start, end = self.mesh.boundaries[i : i + 2]
            # The very same floats at both ends: they are indices, and neighbouring elements share them.
            exact = {0.0: start, 1.0: end}
            rows.append(tuple(exact.get(tau, float(start + width * tau)) for tau in local.tolist()))
        return tuple(rows)

    @cached_property
    def points(self) -> tuple[float, ...]:
        """All stage times in order: where equations hold and controls live. Shared stages count once."""
        return tuple(sorted({time for row in self.stage_times for time in row}))

    @property
    def elements_share_points(self) -> bool:
        """True when the last stage of an element is the first of the next."""
        return self.scheme.starts_on_a_stage and self.scheme.stiffly_accurate

    @cached_property
    def times(self) -> tuple[float, ...]:
        """Boundaries and state nodes in order: where states live."""
        return tuple(sorted({*self.mesh.boundaries, *(time for row in self.node_times for time in row)}))

    @cached_property
    def node_positions(self) -> Indices:
        """Where the state's nodes of each element stand in `times`, shape ``(N, nodes)``."""
        return _positions(self.times, self.node_times)

    @cached_property
    def stage_positions(self) -> Indices:
        """Where the stages of each element stand in `points`, shape ``(N, s)``."""
        return _positions(self.points, self.stage_times)

    @cached_property
    def element_of(self) -> dict[float, int]:
        """Element number of each point; a shared one belongs to the element that ends there."""
        elements: dict[float, int] = {}
        for i, row in enumerate(self.stage_times):
            for time in row:
                elements.setdefault(time, i)
        return elements

    @cached_property
    def row_places(self) -> dict[float, tuple[int, int]]:
        """Element and row of the scheme of each point that has a collocation row, element by element."""
        rows = list(enumerate(self.scheme.row_stages))
        return {times[stage]: (i, row) for i, times in enumerate(self.stage_times) for row, stage in rows}

    @cached_property
    def quadrature_weights(self) -> dict[float, float]:
        """Sum of ``h_i b_k`` over the stages at each point: running costs are sums with these weights."""
        weights = dict.fromkeys(self.points, 0.0)
        for width, row in zip(self.mesh.widths, self.stage_times, strict=True):
            for weight, time in zip(self.scheme.b, row, strict=True):
                weights[time] += float(width * weight)
        return weights

    def _summary(self) -> str:
        start, end = self.mesh.boundaries[0], self.mesh.boundaries[-1]
        return f"{self.scheme.name} on {self.mesh.elements} elements from {start:g} to {end:g}"


def _positions(times: tuple[float, ...], per_element: tuple[tuple[float, ...], ...]) -> Indices:
    position = {time: i for i, time in enumerate(times)}
    return np.array([[position[time] for time in row] for row in per_element])


def mesh_with(mesh: Mesh, times: Iterable[float]) -> Mesh:
    """A mesh with further boundaries at given times inside of it."""
    first, last = mesh.boundaries[0], mesh.boundaries[-1]
    inside = {time for time in times if first < time < last}
    return mesh if inside <= set(mesh.boundaries) else Mesh(tuple(sorted({*mesh.boundaries, *inside})))


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
    common: float = delays[0]
    for delay in delays[1:]:
        one, other = common, delay
        while other > 1e-9 * common:
            one, other = other, math.fmod(one, other)
            other = 0.0 if one - other < 1e-9 * common else other
            if one < least:
                return None
        common = one
    return common if common >= least else None


# -------------------------------------------------------------------------------------------------------- better meshes


# A split aims below the tolerance and a join further below, so that the next estimate seldom calls for the contrary.
_AIM_OF_SPLITTING = 0.5
_AIM_OF_JOINING = 0.05
# A boundary moves over this part of an element at most.
_NEAR = 0.2


def remesh(
    mesh: Mesh,
    errors: ArrayLike,
    tolerance: float,
    order: int,
    *,
    most_parts: int = 4,
    keep: Collection[float] | None = None,
    jumps: Mapping[int, float] | None = None,
) -> Mesh:
    """A mesh whose elements are expected to meet a tolerance.

    With the local error ``e = C h^(order + 1)``, an element whose error exceeds the tolerance is split into
    ``ceil((e / aim)^(1 / (order + 1)))`` equal parts, and neighbours whose union is expected far below the tolerance
    are joined.

    Parameters
    ----------
    mesh : Mesh
    errors : array, shape (N,)
        Per element; infinite ones count as very large.
    tolerance : float
    order : int
        Of the scheme, at element ends.
    most_parts : int
        Into which one element is split at once: far from its asymptotic order an error says little.
    keep : collection of float, optional
        Boundaries that stay; all of them by default, so that nothing is joined.
    jumps : mapping of int to float, optional
        Local fractions at which elements are split in two instead of equal parts. A boundary that need not stay and is
        near to such a place moves there.
    """
    element_errors = np.maximum(np.asarray(errors, dtype=float), ROUNDING)
    tolerance = max(tolerance, ROUNDING)  # no mesh is better than that
    # Beside a singularity elements would become ever narrower, and errors no smaller.
    narrowest = NEGLIGIBLE * (mesh.boundaries[-1] - mesh.boundaries[0])
    element_errors = np.where(np.array(mesh.widths) > narrowest, element_errors, np.minimum(element_errors, tolerance))
    power = 1.0 / (order + 1)
    fixed = set(mesh.boundaries) if keep is None else set(keep)
    boundaries = [mesh.boundaries[0]]
    i = 0
    while i < mesh.elements:
        start, end = mesh.boundaries[i : i + 2]
        if element_errors[i] > tolerance and jumps is not None and i in jumps:
            at = start + jumps[i] * (end - start)
            if jumps[i] < _NEAR and start not in fixed and boundaries[-1] == start:
                boundaries.pop()
            boundaries.append(at)
            if jumps[i] > 1.0 - _NEAR and end not in fixed and element_errors[i + 1] <= tolerance:
                i += 1
                end = mesh.boundaries[i + 1]
        elif element_errors[i] > tolerance:
            ratio = (element_errors[i] / (_AIM_OF_SPLITTING * tolerance)) ** power
            parts = most_parts if not math.isfinite(ratio) else min(most_parts, max(2, math.ceil(ratio)))
            boundaries += [start + (end - start) * k / parts for k in range(1, parts)]
        elif i + 1 < mesh.elements and end not in fixed and _can_join(mesh, element_errors, i, tolerance, power):
            i += 1
            end = mesh.boundaries[i + 1]
        boundaries.append(end)
        i += 1
    return Mesh(tuple(boundaries))


def halves_of(mesh: Mesh) -> Mesh:
    """The mesh with each element in two."""
    return remesh(mesh, np.full(mesh.elements, np.inf), 1.0, 1, most_parts=2)


def _can_join(mesh: Mesh, errors: NDArray[np.float64], i: int, tolerance: float, power: float) -> bool:
    """True when the union of an element and the next is expected to stay far below the tolerance."""
    union = mesh.widths[i] + mesh.widths[i + 1]
    expected = max(errors[k] * (union / mesh.widths[k]) ** (1.0 / power) for k in (i, i + 1))
    return bool(expected <= _AIM_OF_JOINING * tolerance)
