"""Flows of differential equations over many elements at once, and the motion that they are together.

On parts of all elements, side by side, the states are polynomials that meet the equations at the points of the Radau
IIA method, of order fifteen: far above the orders of meshes, and for stiff equations as well. Between these points the
equations tell how far the polynomials are from them; parts where that is too much are halved. One element after the
other, as a motion is, would take as many calls as there are elements: here Newton's method finds all polynomials and
the starts of all parts at which their ends meet.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from .arrays import Array, BoolArray, ComplexArray
from .lagrange import evaluation_matrix
from .schemes import Scheme, radau

# (local fractions (q,), states (n, k, N, q)) -> derivatives by the local fraction, of the same shape, for k variants of
# the states.
Rates = Callable[[Array, Array], Array]

# Of the Radau IIA method on each part.
_STAGES = 8
# From so many parts more than the rules ask for there is a corner, beside which more of them bring little; and how
# exactly it is met there.
_PARTS_AT_CORNER, _AT_CORNER = 64, 1e-6
# With more parts than that, or more derivatives of states in all (hundreds of megabytes), equations are not followed.
_MOST_PARTS, _MOST_DERIVATIVES = 512, 5_000_000
# Relative to the scale of each state: the step of differences.
_DIFFERENCE = 1e-6
# Slopes are trusted farther where what they leave is less than this share of how far they were trusted.
_STILL_LINEAR = 0.1
# Sweeps that bring nothing before the motion counts as one that cannot be followed.
_SWEEPS = 12


@dataclass(frozen=True)
class Flows:
    """What equations do over ``N`` elements with ``n`` states, at ``k`` fractions of each.

    Attributes
    ----------
    fractions : array, shape (k,)
    local : array, shape (N, k, n)
        Each element from its own start.
    whole : array, shape (N, k, n), or None
        From the start of the first element on; None where that could not be followed, or left the finite numbers.
    """

    fractions: Array
    local: Array
    whole: Array | None

    def at(self, fractions: Array) -> Flows:
        """At some of the fractions."""
        at = np.searchsorted(self.fractions, fractions)
        return Flows(fractions, self.local[:, at], None if self.whole is None else self.whole[:, at])


@cache
def _scheme() -> Scheme:
    return radau(_STAGES)


@cache
def _eigenvalues() -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Of the matrix of the method, with its eigenvectors and their inverse: they part its equations by stages.

    Of two that are conjugate, one stands for both: what belongs to it counts twice, and its real part is taken.
    """
    values, vectors = np.linalg.eig(_scheme().A.astype(complex))
    inverse, kept = np.linalg.inv(vectors), values.imag >= 0.0
    return values[kept], vectors[:, kept] * np.where(values[kept].imag > 0.0, 2.0, 1.0), inverse[kept]


@cache
def _between() -> tuple[Array, Array, Array, Array]:
    """Local places between the points, their weights, and values there by values at all nodes and at the stages."""
    nodes = _scheme().state_nodes
    places = (nodes[1:] + nodes[:-1]) / 2
    return places, np.diff(nodes), evaluation_matrix(nodes, places), evaluation_matrix(_scheme().c, places)


@dataclass(frozen=True, eq=False)
class _Path:
    """States on all parts of all elements.

    Attributes
    ----------
    breaks : array, shape (p + 1,)
        Local fractions where parts end.
    values : array, shape (n, N, p, s + 1)
        At the start and the stages of each part.
    """

    breaks: Array
    values: Array

    @classmethod
    def of(cls, breaks: Array, states: Callable[[Array], Array]) -> _Path:
        """Through what states are at local fractions, shape ``(n, N, q)``."""
        nodes = breaks[:-1, None] + np.diff(breaks)[:, None] * _scheme().state_nodes
        values = states(nodes.ravel())
        return cls(breaks, values.reshape(*values.shape[:2], *nodes.shape))

    @cached_property
    def widths(self) -> Array:
        """Of the parts."""
        return np.diff(self.breaks)

    def fractions(self, places: Array) -> Array:
        """Local fractions of the element at local places of each part, one part after the other."""
        return np.asarray((self.breaks[:-1, None] + self.widths[:, None] * places).ravel())

    def at(self, fractions: Array) -> Array:
        """States at local fractions, shape ``(n, N, q)``."""
        part = np.clip(np.searchsorted(self.breaks, fractions, side="right") - 1, 0, len(self.widths) - 1)
        basis = evaluation_matrix(_scheme().state_nodes, (fractions - self.breaks[part]) / self.widths[part])
        return np.einsum("aeqs,qs->aeq", self.values[:, :, part], basis)


def integrate_flows(
    rates: Rates,
    planned: Callable[[Array], Array],
    scales: Array,
    fractions: Array,
    tolerance: float,
    first: Array | None,
    breaks: Array | None = None,
) -> Flows | None:
    """Integrate all elements, each from its own start, and the motion from the first start on.

    Parameters
    ----------
    rates : callable
        ``rates(fractions, states)`` with states of shape ``(n, k, N, q)``: derivatives by the local fraction, for ``k``
        variants at q fractions.
    planned : callable
        From local fractions, shape ``(q,)``, to states about there, shape ``(n, N, q)``; elements start at its first.
    scales : array, shape (n,)
        Sizes of the states.
    fractions : array, shape (k,)
        Where in each element states are wanted, from 0 to 1.
    tolerance : float
        Of the integration, relative to the scales.
    first : array, shape (n,), or None
        Where the whole motion starts; None where that is not followed.
    breaks : array, optional
        Local fractions from 0 to 1: on each part between them the rates are smooth functions of the time.

    Returns
    -------
    Flows or None
        None where the tolerance is not met, since the equations are not smooth, or have no finite values.
    """
    search = _Search(rates, scales, tolerance)
    breaks = np.array([0.0, 1.0]) if breaks is None else breaks
    guess = _Path.of(breaks, planned)
    with np.errstate(all="ignore"):  # what is unstable may overflow, and is not taken
        local = search.solved(guess, None)
        if local is None:
            return None
        whole = None if first is None else search.solved(local, first)
    return Flows(fractions, _by_element(local, fractions), None if whole is None else _by_element(whole, fractions))


def _by_element(path: _Path, fractions: Array) -> Array:
    """States at fractions, shape ``(N, k, n)``."""
    return np.ascontiguousarray(path.at(fractions).transpose(1, 2, 0))


class _Search:
    """Newton's method for polynomials that meet the equations, and on as many parts as it takes.

    Parameters
    ----------
    rates, scales, tolerance
        As for `integrate_flows`.
    """

    def __init__(self, rates: Rates, scales: Array, tolerance: float) -> None:
        self._rates, self._scales, self._tolerance = rates, scales, tolerance

    def solved(self, path: _Path, first: Array | None) -> _Path | None:
        """The path from these starts on; None where it cannot be followed."""
        asked, states = len(path.widths), len(path.values)
        while True:
            is_large = path.values[0, ..., 0].size * states**2 > _MOST_DERIVATIVES
            met = None if is_large else self._met(path, first)
            if met is None:
                return None
            defects = self._defects(met)
            parts = len(met.widths)
            is_at_corner = parts >= asked + _PARTS_AT_CORNER
            tolerance = max(self._tolerance, _AT_CORNER) if is_at_corner else self._tolerance
            if float(defects.sum()) <= tolerance:
                return met
            large = defects > tolerance / (2 * parts)
            if not np.isfinite(defects).all() or parts + int(large.sum()) > asked + _MOST_PARTS:
                return None
            middles = (met.breaks[1:] + met.breaks[:-1])[large] / 2
            path = _Path.of(np.sort(np.concatenate([met.breaks, middles])), met.at)

    def _slopes(self, fractions: Array, states: Array) -> Array:
        """Rates of states of shape ``(n, k, N, p, s)``, as they are after these fractions of all parts."""
        shape = states.shape
        return self._rates(fractions, states.reshape(*shape[:3], -1)).reshape(shape)

    def _defects(self, path: _Path) -> Array:
        """How far each part is from the equations between its stages."""
        places, weights, of_nodes, of_stages = _between()
        states = path.values[:, None]
        slopes = self._slopes(path.fractions(_scheme().c), states[..., 1:])[:, 0]
        there = self._slopes(path.fractions(places), states @ of_nodes.T)[:, 0]
        left = np.abs(slopes @ of_stages.T - there) @ weights * path.widths
        return np.asarray((left.max(axis=1) / self._sizes(path.values)[:, None]).max(axis=0))

    def _sizes(self, values: Array) -> Array:
        """Where elements lead far from the plan, relative to how far: less would be rounding."""
        return np.maximum(self._scales, np.abs(values).max(axis=(1, 2, 3)))

    def _met(self, path: _Path, first: Array | None) -> _Path | None:
        """Polynomials that meet the equations at the stages, and each other at the ends of parts.

        An unstable motion goes far from the elements' own starts, where slopes along these say nothing: starts are
        moved only as far along the motion as slopes are trusted, and the next sweep goes on from there. They are
        trusted farther where moves of the starts have left little to move at the stages.
        """
        values, scheme = path.values.copy(), _scheme()
        stages, by_stages = path.fractions(scheme.c), path.widths[:, None, None] * scheme.A
        most, least, before, waited, linear, trust = -1, np.inf, np.inf, 0, None, 1.0
        while waited < _SWEEPS:
            sizes = self._sizes(values)
            if linear is None:
                linear, slopes = self._linearised(path.widths, stages, values)
            else:
                slopes = self._slopes(stages, values[:, None, :, :, 1:])[:, 0]
            left = values[..., :1] - values[..., 1:] + np.einsum("aepj,pij->aepi", slopes, by_stages)
            moves = linear.solve(left)
            is_trusted = (np.abs(moves).max(axis=(1, 2, 3)) <= _STILL_LINEAR * trust * sizes).all()
            trust = 4.0 * trust if is_trusted else max(1.0, trust / 4.0)
            starts, told = _moves_of_starts(values, moves[..., -1], linear.by_start[-1], first, trust * sizes)
            moves += np.einsum("sepab,bep->aeps", linear.by_start, starts)
            values[..., 0] += starts
            values[..., 1:] += moves
            largest = np.maximum(np.abs(moves).max(axis=3), np.abs(starts)) / sizes[:, None, None]
            met = told & (largest <= 0.1 * self._tolerance).all(axis=0)
            if met.all():
                return _Path(path.breaks, values)
            size = float(largest.max())
            if not np.isfinite(size):
                return None
            count = int(met.sum())
            is_better = count > most or size <= 0.5 * least
            most, least, waited = max(count, most), min(size, least), 0 if is_better else waited + 1
            linear = linear if size <= 0.1 * before else None
            before = size
        return None

    def _linearised(self, widths: Array, stages: Array, values: Array) -> tuple[_Linear, Array]:
        """The equations of all parts with the mean derivatives on each, and the slopes at the stages."""
        n = len(values)
        steps = _DIFFERENCE * self._sizes(values)
        varied = np.repeat(values[:, None, :, :, 1:], n + 1, axis=1)
        varied[np.arange(n), np.arange(n) + 1] += steps[:, None, None, None]
        slopes = self._slopes(stages, varied)
        jacobians = (slopes[:, 1:] - slopes[:, :1]).mean(axis=4) / steps[:, None, None]
        return _Linear.of(widths, jacobians.transpose(2, 3, 0, 1)), slopes[:, 0]


@dataclass(frozen=True, eq=False)
class _Linear:
    """The linear equations of all parts, solved.

    Attributes
    ----------
    inverses : complex array, shape (m, N, p, n, n)
        For each of m eigenvalues of the method.
    by_start : array, shape (s, N, p, n, n)
        Derivatives of the states at the stages by those at the start.
    """

    inverses: ComplexArray
    by_start: Array

    @classmethod
    def of(cls, widths: Array, jacobians: Array) -> _Linear:
        """With derivatives of the rates by the states, shape ``(N, p, n, n)``."""
        values, vectors, inverse = _eigenvalues()
        scaled = widths[:, None, None] * jacobians
        matrices = np.eye(jacobians.shape[-1]) - values[:, None, None, None, None] * scaled
        if not np.isfinite(matrices).all():
            matrices = np.broadcast_to(np.nan, matrices.shape)
        inverses = np.asarray(np.linalg.inv(matrices), dtype=np.complex128)
        by_start = np.einsum("is,sepab,s->iepab", vectors, inverses, inverse.sum(axis=1)).real
        return cls(inverses, np.asarray(by_start, dtype=np.float64))

    def solve(self, left: Array) -> Array:
        """Moves of the states at the stages, shape ``(n, N, p, s)``, that take away what is left of the equations."""
        _, vectors, inverse = _eigenvalues()
        return np.asarray((np.einsum("sepab,beps->aeps", self.inverses, left @ inverse.T) @ vectors.T).real)


def _moves_of_starts(
    values: Array, moves: Array, by_start: Array, first: Array | None, trusted: Array
) -> tuple[Array, BoolArray]:
    """Moves (n, N, p) of the starts of parts, one after the other, and where slopes can tell them (N, p).

    Parameters
    ----------
    values : array, shape (n, N, p, s + 1)
    moves : array, shape (n, N, p)
        Of the ends, beside those by the starts.
    by_start : array, shape (N, p, n, n)
        Derivatives of the ends by the starts.
    first : array, shape (n,), or None
        Without it every element keeps its own start.
    trusted : array, shape (n,)
        How far slopes are trusted.
    """
    n, elements, parts, _ = values.shape
    motions = elements if first is None else 1
    starts, ends = (of.reshape(n, motions, -1) for of in (values[..., 0], values[..., -1] + moves))
    found, slopes = np.zeros(starts.shape), by_start.reshape(motions, -1, n, n)
    told = np.ones(starts.shape[1:], dtype=bool)
    if first is not None:
        found[:, 0, 0] = first - starts[:, 0, 0]
    for part in range(1, starts.shape[2]):
        passed_on = (slopes[:, part - 1] @ found[:, :, part - 1].T[..., None])[..., 0].T
        told[:, part] = told[:, part - 1] & (np.abs(passed_on) <= trusted[:, None]).all(axis=0)
        changes = passed_on + ends[:, :, part - 1] - starts[:, :, part]
        found[:, :, part] = np.where(told[:, part], changes, 0.0)
    return found.reshape(n, elements, parts), told.reshape(elements, parts)
