"""Flows of differential equations over many elements at once, and the motion that they are together.

The elements are integrated side by side by the classical Runge-Kutta method, with steps that are halved until the
extrapolated result no longer changes; where that is hopeless since the equations are stiff, by an implicit one. One
element after the other, as a motion is, would take as many calls as there
are elements: here Newton's method finds the starts of all elements at which the ends meet.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .arrays import Array
from .stiff_flows import march_implicitly

# (local fraction, states of shape (n, k, N)) -> derivatives by the local fraction, of the same shape.
Rates = Callable[[float, Array], Array]

# Steps between two samples, doubled from the first number up to the last before the equations count as too stiff.
_FIRST_STEPS, _MOST_STEPS = 1, 128
# From so many steps on, a result that is not finite, or an error of the size of the states, is a sign of stiffness.
_STIFF_STEPS = 8
_ORDER_FACTOR = 15.0  # two raised to the order of the method, minus one
# Relative to the scale of each state: the step of differences, and how well the ends of elements meet.
_DIFFERENCE = 1e-6
_SWEEPS = 12
# Sweeps times elements, at most, of an unstable motion; from which sweep on slopes are found anew; changes in scales.
_MOST_ELEMENTS = 20_000
_SWEEPS_WITH_FIRST_SLOPES = 3
_TRUSTED = 1.0
# A sweep that evaluates rates more often meets corners far from the plan: the next ones would not be cheaper.
_MOST_EVALUATIONS_OF_A_SWEEP = 4000


@dataclass(frozen=True)
class Flows:
    """What equations do over ``N`` elements with ``n`` states, at ``k`` equidistant fractions of each.

    Attributes
    ----------
    local : array, shape (N, k, n)
        Each element from its own start.
    whole : array, shape (N, k, n), or None
        From the start of the first element on; None where that could not be followed, or left the finite numbers.
    error : float
        Estimated error of the integration, relative to the scales.
    """

    local: Array
    whole: Array | None
    error: float


def integrate_flows(
    rates: Rates, starts: Array, scales: Array, samples: int, tolerance: float, first: Array | None = None
) -> Flows | None:
    """Integrate all elements, each from its own start, and the motion from the first start on.

    Parameters
    ----------
    rates : callable
        ``rates(fraction, states)`` of shape ``(n, k, N)``: derivatives by the local fraction, for ``k`` variants.
    starts : array, shape (N, n)
        Where each element starts.
    scales : array, shape (n,)
        Sizes of the states.
    samples : int
        How many parts each element is sampled at.
    tolerance : float
        Of the integration, relative to the scales.
    first : array, shape (n,), optional
        Where the whole motion starts; by default where the first element does.

    Returns
    -------
    Flows or None
        None where the tolerance is not met, since the equations are not smooth, or have no finite values.
    """
    base = starts.T[:, None, :]
    steps = _DIFFERENCE * scales
    varied = np.concatenate([base, base + np.diag(steps)[:, :, None]], axis=1)
    found = _march(rates, varied, scales, samples, tolerance)
    if found is None:
        return None
    paths, error, stiff = found
    slopes = (paths[-1][:, 1:, :] - paths[-1][:, :1, :]) / steps[None, :, None]
    local = paths[:, :, 0, :]
    first = starts[0] if first is None else first
    whole = _from_first_start(rates, starts, local, slopes, scales, tolerance, first, stiff=stiff)
    return Flows(_by_element(local), whole, error)


def integrate_elements(
    rates: Rates, starts: Array, scales: Array, samples: int, tolerance: float
) -> tuple[Array, float] | None:
    """Integrate all elements, each from its own start; parameters as for `integrate_flows`.

    Returns
    -------
    (paths, error) or None
        ``paths`` of shape ``(N, k, n)``; None as from `integrate_flows`.
    """
    found = _march(rates, starts.T[:, None, :], scales, samples, tolerance)
    return None if found is None else (_by_element(found[0][:, :, 0, :]), found[1])


def _by_element(paths: Array) -> Array:
    """From (k, n, N) to (N, k, n)."""
    return np.ascontiguousarray(paths.transpose(2, 0, 1))


def _from_first_start(
    rates: Rates,
    starts: Array,
    paths: Array,
    slopes: Array,
    scales: Array,
    tolerance: float,
    first: Array,
    *,
    stiff: bool,
) -> Array | None:
    """Newton's method for the starts at which the ends of elements meet; `slopes` are those of the first sweep.

    An unstable motion goes far from the elements' own starts, where slopes along these say nothing: starts are moved
    only as far along the motion as slopes tell how, and later sweeps, with slopes of their own, go on from there. At
    least one more element meets the one before it after each sweep. Where the motion of each element was not stiff,
    that from the first start is at most unstable: implicit steps would follow it far away, at great cost.
    """
    now, sizes = starts.T.copy(), scales
    elements = now.shape[1]
    best, waited = -1, 0
    counted = _Counted(rates)
    for sweep in range(max(_SWEEPS, _MOST_ELEMENTS // elements)):
        now = now + _moves(now, paths[-1], slopes, first, _TRUSTED * sizes)
        # What grows far beyond the plan is followed relative to its own size.
        sizes = np.maximum(scales, np.abs(now).max(axis=1))
        varied = now[:, None, :]
        if sweep >= _SWEEPS_WITH_FIRST_SLOPES:
            steps = _DIFFERENCE * sizes
            varied = np.concatenate([varied, varied + np.diag(steps)[:, :, None]], axis=1)
        before = counted.calls
        found = _march(counted, varied, sizes, len(paths) - 1, tolerance, may_be_stiff=stiff)
        if found is None:
            return None
        paths = found[0][:, :, 0, :]
        if sweep >= _SWEEPS_WITH_FIRST_SLOPES:
            slopes = (found[0][-1][:, 1:, :] - found[0][-1][:, :1, :]) / steps[None, :, None]
        left = np.abs(paths[-1][:, :-1] - now[:, 1:]) > 10 * tolerance * sizes[:, None]
        if not left.any():
            return _by_element(paths)
        met = int(left.any(axis=0).argmax())
        best, waited = (met, 0) if met > best else (best, waited + 1)
        if waited >= _SWEEPS or counted.calls - before > _MOST_EVALUATIONS_OF_A_SWEEP:
            return None
    return None


class _Counted:
    """Rates that count how often they are evaluated."""

    def __init__(self, rates: Rates) -> None:
        self._rates, self.calls = rates, 0

    def __call__(self, fraction: float, states: Array) -> Array:
        self.calls += 1
        return self._rates(fraction, states)


def _moves(now: Array, ends: Array, slopes: Array, first: Array, trusted: Array) -> Array:
    """Changes (n, N) of all starts, one element after the other, up to where they leave what the slopes can tell."""
    changes = np.zeros_like(now)
    changes[:, 0] = first - now[:, 0]
    gaps = ends[:, :-1] - now[:, 1:]
    with np.errstate(all="ignore"):  # what is unstable may overflow, and is not taken
        for i in range(gaps.shape[1]):
            passed_on = slopes[:, :, i] @ changes[:, i]
            if not (np.abs(passed_on) <= trusted).all():
                break
            changes[:, i + 1] = passed_on + gaps[:, i]
    return changes


def _march(
    rates: Rates, starts: Array, scales: Array, samples: int, tolerance: float, *, may_be_stiff: bool = True
) -> tuple[Array, float, bool] | None:
    """States (k, n, variants, N) at the samples, with halved steps until they no longer change.

    Also the error left, and whether implicit steps were needed.
    """
    steps, looked_stiff = _FIRST_STEPS, not may_be_stiff
    with np.errstate(all="ignore"):
        coarse = _runge_kutta(rates, starts, samples, steps)
        while steps < _MOST_STEPS:
            steps *= 2
            fine = _runge_kutta(rates, starts, samples, steps)
            correction = (fine - coarse) / _ORDER_FACTOR
            error = float((np.abs(correction).max(axis=(0, 2, 3)) / scales).max())
            if error <= tolerance:
                return fine + correction, error, False
            if not looked_stiff and steps >= _STIFF_STEPS and not error <= 1.0:
                looked_stiff = True
                found = march_implicitly(rates, starts, scales, samples, tolerance)
                if found is not None:
                    return *found, True
            coarse = fine
    found = None if looked_stiff else march_implicitly(rates, starts, scales, samples, tolerance)
    return None if found is None else (*found, True)


def _runge_kutta(rates: Rates, states: Array, samples: int, steps: int) -> Array:
    paths = np.empty((samples + 1, *states.shape))
    paths[0] = states
    h = 1.0 / (samples * steps)
    for step in range(samples * steps):
        start, middle, end = step * h, (step + 0.5) * h, (step + 1) * h
        first = rates(start, states)
        second = rates(middle, states + 0.5 * h * first)
        third = rates(middle, states + 0.5 * h * second)
        fourth = rates(min(end, 1.0), states + h * third)
        states = states + h / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
        if (step + 1) % steps == 0:
            paths[(step + 1) // steps] = states
    return paths
