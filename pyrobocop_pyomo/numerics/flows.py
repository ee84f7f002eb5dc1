"""Flows of differential equations over many elements at once, and the motion that they are together.

The elements are integrated side by side by the classical Runge-Kutta method, with steps that are halved until the
extrapolated result no longer changes; where that is hopeless, as for stiff equations, nothing is found. One element
after the other, as a motion is, would take as many calls as there are elements: here Newton's method finds the starts
of all elements at which the ends meet.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .arrays import Array

# (local fraction, states of shape (n, k, N)) -> derivatives by the local fraction, of the same shape.
Rates = Callable[[float, Array], Array]

# Steps between two fractions, doubled from one up to this number before the equations count as too stiff.
_MOST_STEPS = 128
# Steps over an element with many fractions, at most.
_MOST_STEPS_IN_ALL = 4096
# From so many steps on, a result that is not finite, or an error of the size of the states, is a sign of stiffness.
_STIFF_STEPS = 8
# Motions are looked at after every so many of the wider steps of the last two integrations.
_STEPS_PER_INSTANT = 2
_ORDER_FACTOR = 15.0  # two raised to the order of the method, minus one
# Relative to the scale of each state: the step of differences, and how well the ends of elements meet.
_DIFFERENCE = 1e-6
_SWEEPS = 12
# Sweeps times elements, at most, of an unstable motion; from which sweep on slopes are found anew.
_MOST_ELEMENTS = 20_000
_SWEEPS_WITH_FIRST_SLOPES = 3


@dataclass(frozen=True)
class Flows:
    """What equations do over ``N`` elements with ``n`` states, at ``k`` fractions of each.

    Attributes
    ----------
    fractions : array, shape (k,)
        Those that were requested, and more where the integration took many steps in between.
    local : array, shape (N, k, n)
        Each element from its own start.
    whole : array, shape (N, k, n), or None
        From the start of the first element on; None where that could not be followed, or left the finite numbers.
    """

    fractions: Array
    local: Array
    whole: Array | None


def integrate_flows(
    rates: Rates, starts: Array, scales: Array, fractions: Array, tolerance: float, first: Array | None
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
    fractions : array, shape (k,)
        Where in each element states are wanted, from 0 to 1. On each part the rates are smooth functions of the time.
    tolerance : float
        Of the integration, relative to the scales.
    first : array, shape (n,), or None
        Where the whole motion starts; None where that is not followed.

    Returns
    -------
    Flows or None
        None where the tolerance is not met, since the equations are not smooth, or have no finite values.
    """
    varied = starts.T[:, None, :]
    steps = _DIFFERENCE * scales
    if first is not None:
        varied = np.concatenate([varied, varied + np.diag(steps)[:, :, None]], axis=1)
    found = _march(rates, varied, scales, fractions, tolerance)
    if found is None:
        return None
    whole = None
    if first is not None:
        slopes = (found.ends[:, 1:, :] - found.ends[:, :1, :]) / steps[None, :, None]
        whole = _from_first_start(rates, starts, found, slopes, scales, fractions, tolerance, first)
    # Both were looked at after each of their steps, which are halved again and again: the fewer are among the more.
    count = len(found.path) if whole is None else min(len(found.path), len(whole))
    local = _by_element(found.path[:: (len(found.path) - 1) // (count - 1)])
    if whole is not None:
        whole = _by_element(whole[:: (len(whole) - 1) // (count - 1)])
    return Flows(_divided(fractions, (count - 1) // (len(fractions) - 1)), local, whole)


def _by_element(paths: Array) -> Array:
    """From (k, n, N) to (N, k, n)."""
    return np.ascontiguousarray(paths.transpose(2, 0, 1))


def _from_first_start(
    rates: Rates,
    starts: Array,
    march: _March,
    slopes: Array,
    scales: Array,
    fractions: Array,
    tolerance: float,
    first: Array,
) -> Array | None:
    """Newton's method for the starts at which the ends of elements meet; `slopes` are those of the first sweep.

    An unstable motion goes far from the elements' own starts, where slopes along these say nothing: starts are moved
    only as far along the motion as slopes tell how, and later sweeps, with slopes of their own, go on from there. At
    least one more element meets the one before it after each sweep. Where the motion of each element was not stiff,
    that from the first start is at most unstable.
    """
    now, sizes = starts.T.copy(), scales
    elements = now.shape[1]
    best, waited = -1, 0
    for sweep in range(max(_SWEEPS, _MOST_ELEMENTS // elements)):
        now = now + _moves(now, march.ends[:, 0], slopes, first, sizes)
        # What grows far beyond the plan is followed relative to its own size.
        sizes = np.maximum(scales, np.abs(now).max(axis=1))
        varied = now[:, None, :]
        if sweep >= _SWEEPS_WITH_FIRST_SLOPES:
            steps = _DIFFERENCE * sizes
            varied = np.concatenate([varied, varied + np.diag(steps)[:, :, None]], axis=1)
        found = _march(rates, varied, sizes, fractions, tolerance, may_be_stiff=False)
        if found is None:
            return None
        march = found
        if sweep >= _SWEEPS_WITH_FIRST_SLOPES:
            slopes = (march.ends[:, 1:, :] - march.ends[:, :1, :]) / steps[None, :, None]
        left = np.abs(march.path[-1][:, :-1] - now[:, 1:]) > 10 * tolerance * sizes[:, None]
        if not left.any():
            return march.path
        met = int(left.any(axis=0).argmax())
        best, waited = (met, 0) if met > best else (best, waited + 1)
        # A sweep that takes so many instants meets corners far from the plan: the next ones would not be cheaper.
        if waited >= _SWEEPS or len(march.path) > _MOST_STEPS * max(1, len(fractions) // 16):
            return None
    return None


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


@dataclass(frozen=True)
class _March:
    """What was integrated: the first variant at many instants (k, n, N), all variants at the end (n, variants, N)."""

    path: Array
    ends: Array


def _march(
    rates: Rates, starts: Array, scales: Array, fractions: Array, tolerance: float, *, may_be_stiff: bool = True
) -> _March | None:
    """Integrate with halved steps until the states at the fractions no longer change."""
    steps = 1
    with np.errstate(all="ignore"):
        coarse, coarse_path = runge_kutta(rates, starts, fractions, steps)
        most_steps = min(_MOST_STEPS, max(_STIFF_STEPS, _MOST_STEPS_IN_ALL // len(fractions)))
        while steps < most_steps:
            steps *= 2
            fine, path = runge_kutta(rates, starts, fractions, steps)
            changes = (np.abs(fine - coarse) / _ORDER_FACTOR).max(axis=(0, 2))
            # Where elements lead far from the plan, relative to how far: less would be rounding.
            sizes = np.maximum(scales[:, None], np.abs(fine).max(axis=(0, 2)))
            error = float((changes / sizes).max())
            # Beside a corner more steps bring little.
            if error <= (tolerance if steps < most_steps else max(tolerance, 1e-6)):
                corrected = path[::2] + (path[::2] - coarse_path) / _ORDER_FACTOR
                ends = fine[-1] + (fine[-1] - coarse[-1]) / _ORDER_FACTOR
                return _March(corrected[:: min(_STEPS_PER_INSTANT, steps // 2)], ends)
            if may_be_stiff and steps >= _STIFF_STEPS and not (changes <= scales[:, None]).all():
                return None
            coarse, coarse_path = fine, path
    return None


def _divided(fractions: Array, parts: int) -> Array:
    """Fractions with so many equal parts between each two of them."""
    places = np.arange(parts * (len(fractions) - 1) + 1) / parts
    return np.interp(places, np.arange(len(fractions)), fractions)


def runge_kutta(rates: Rates, states: Array, fractions: Array, steps: int) -> tuple[Array, Array]:
    """States at the fractions, with so many steps between two of them, and of the first variant after each step."""
    paths, path = [states], [states[:, 0, :]]
    for before, after in pairwise(fractions.tolist()):
        h = (after - before) / steps
        for step in range(steps):
            start, end = before + step * h, after if step + 1 == steps else before + (step + 1) * h
            middle = (start + end) / 2
            first = rates(start, states)
            second = rates(middle, states + 0.5 * h * first)
            third = rates(middle, states + 0.5 * h * second)
            fourth = rates(end, states + h * third)
            states = states + h / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
            path.append(states[:, 0, :])
        paths.append(states)
    return np.array(paths), np.array(path)
