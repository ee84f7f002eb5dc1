"""Flows of differential equations over many elements at once, and the motion that they are together.

All parts of all elements are integrated side by side by the classical Runge-Kutta method, each from about where a plan
is there, with steps that are halved until the extrapolated result no longer changes; where that is hopeless, as for
stiff equations, nothing is found. One part after the other, as a motion is, would take as many calls as there are
parts: here Newton's method finds the starts of all parts at which their ends meet.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from .arrays import Array, BoolArray

# (local fractions (p,), states of shape (n, k, N, p)) -> derivatives by the local fraction, of the same shape.
Rates = Callable[[Any, Array], Array]

# Steps between two fractions, doubled from two up to this number before the equations count as too stiff.
_MOST_STEPS = 128
# Steps over an element with many fractions, at most.
_MOST_STEPS_IN_ALL = 4096
# From so many steps on, a result that is not finite, or an error of the size of the states, is a sign of stiffness.
_STIFF_STEPS = 8
_ORDER_FACTOR = 15.0  # two raised to the order of the method, minus one
# Relative to the scale of each state: the step of differences.
_DIFFERENCE = 1e-6
# Sweeps that bring nothing before the motion counts as one that cannot be followed.
_SWEEPS = 12
# Sweeps times elements, at most, of an unstable motion.
_MOST_ELEMENTS = 20_000


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


def integrate_flows(
    rates: Rates, planned: Array, scales: Array, fractions: Array, tolerance: float, first: Array | None
) -> Flows | None:
    """Integrate all elements, each from its own start, and the motion from the first start on.

    Parameters
    ----------
    rates : callable
        ``rates(fractions, states)`` of shape ``(n, k, N, p)``: derivatives by the local fraction, for ``k`` variants at
        one fraction of each part.
    planned : array, shape (N, k, n)
        Where each element starts, and about where its states are at the fractions.
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
    meet = partial(_meeting, rates, scales=scales, fractions=fractions, tolerance=tolerance)
    starts = planned[:, :-1].transpose(2, 0, 1)
    with np.errstate(all="ignore"):  # what is unstable may overflow, and is not taken
        local = meet(_march(rates, starts, scales, fractions, tolerance), None)
        if local is None:
            return None
        whole = None if first is None else meet(local[0], first)
    return Flows(fractions, local[1], None if whole is None else whole[1])


@dataclass(frozen=True)
class _March:
    """What was integrated on all parts.

    Attributes
    ----------
    starts, ends : array, shape (n, N, p)
        Of the parts.
    slopes : array, shape (n, n, N, p)
        Derivatives of the ends by the starts.
    steps : int
        On each part.
    """

    starts: Array
    ends: Array
    slopes: Array
    steps: int


def _meeting(
    rates: Rates, march: _March | None, first: Array | None, *, scales: Array, fractions: Array, tolerance: float
) -> tuple[_March, Array] | None:
    """Newton's method for the starts at which the ends of parts meet: the last march, and the states (N, p + 1, n).

    Without a first state every element keeps its own start. An unstable motion goes far from these, where slopes along
    them say nothing: starts are moved only as far along the motion as slopes tell how, and the next sweep goes on from
    there. At least one more part meets the one before it after each sweep.
    """
    sizes, most, waited, left = scales, -1, 0, _MOST_ELEMENTS
    while march is not None and left > 0:
        left -= march.ends.shape[1]
        moves, trusted = _moves(march, first, sizes)
        nodes = np.concatenate([march.starts, march.ends[:, :, -1:]], axis=2) + moves
        # What grows far beyond the plan is followed relative to its own size.
        sizes = np.maximum(scales, np.abs(nodes).max(axis=(1, 2)))
        # What Newton's method leaves is the square of its last step.
        met = trusted & (np.abs(moves) <= np.sqrt(tolerance) * sizes[:, None, None]).all(axis=0)
        if met.all():
            return march, np.ascontiguousarray(nodes.transpose(1, 2, 0))
        count = int(met.sum())
        most, waited = (count, 0) if count > most else (most, waited + 1)
        # A sweep of so many steps meets corners far from the plan: the next ones would not be cheaper.
        many = 4 * _MOST_STEPS * max(1, len(fractions) // 16)
        if waited >= _SWEEPS or march.steps * (len(fractions) - 1) >= many:
            return None
        march = _march(rates, nodes[:, :, :-1], sizes, fractions, tolerance, march.steps)
    return None


def _moves(march: _March, first: Array | None, trusted: Array) -> tuple[Array, BoolArray]:
    """Changes (n, N, p + 1) of all states, one part after the other, and where slopes can tell them (N, p + 1)."""
    n, elements, parts = march.ends.shape
    starts, ends = (of.transpose(2, 1, 0) for of in (march.starts, march.ends))
    slopes = np.ascontiguousarray(march.slopes.transpose(3, 2, 0, 1))
    # Of each element by itself, and by the states at its start.
    own, by_start = np.zeros((parts + 1, elements, n)), np.zeros((parts + 1, elements, n, n))
    by_start[0] = np.eye(n)
    told = np.ones((parts + 1, elements), dtype=bool)
    for part in range(parts):
        by_start[part + 1] = slopes[part] @ by_start[part]
        passed_on = (slopes[part] @ own[part, :, :, None])[:, :, 0]
        told[part + 1] = told[part] & (np.abs(passed_on) <= trusted).all(axis=1)
        gaps = ends[part] - starts[part + 1] if part + 1 < parts else 0.0
        own[part + 1] = np.where(told[part + 1, :, None], passed_on + gaps, 0.0)
    if first is not None:
        jumps = ends[-1, :-1] + own[-1, :-1] - starts[0, 1:]
        changes = np.zeros((elements, n))
        changes[0] = first - starts[0, 0]
        for i in range(elements - 1):
            passed_on = by_start[-1, i] @ changes[i]
            if not (np.abs(passed_on) <= trusted).all():
                told[:, i + 1 :] = False
                break
            changes[i + 1] = passed_on + jumps[i]
        own += (by_start @ changes[:, :, None])[..., 0]
    return own.transpose(2, 1, 0), told.T


def _march(
    rates: Rates, starts: Array, scales: Array, fractions: Array, tolerance: float, steps: int | None = None
) -> _March | None:
    """Integrate all parts with halved steps until their ends no longer change; from so many steps on, if known."""
    before, after = fractions[:-1], fractions[1:]
    differences = _DIFFERENCE * scales
    varied = np.concatenate([starts[:, None], starts[:, None] + np.diag(differences)[:, :, None, None]], axis=1)
    may_be_stiff, steps = steps is None, steps or 2
    most_steps = min(_MOST_STEPS, max(_STIFF_STEPS, _MOST_STEPS_IN_ALL // len(fractions)))
    while True:
        coarse = runge_kutta(rates, varied, before, after, steps // 2)
        fine = runge_kutta(rates, varied[:, :1], before, after, steps)[:, 0]
        changes = (fine - coarse[:, 0]) / _ORDER_FACTOR
        # They add up along an element.
        largest = np.abs(changes).sum(axis=2).max(axis=1)
        # Where elements lead far from the plan, relative to how far: less would be rounding.
        error = float((largest / np.maximum(scales, np.abs(fine).max(axis=(1, 2)))).max())
        # Beside a corner more steps bring little.
        if error <= (tolerance if steps < most_steps else max(tolerance, 1e-6)):
            slopes = (coarse[:, 1:] - coarse[:, :1]) / differences[:, None, None]
            return _March(starts, fine + changes, slopes, steps)
        is_stiff = may_be_stiff and steps >= _STIFF_STEPS and not (largest <= scales).all()
        if is_stiff or steps >= most_steps:
            return None
        steps *= 2


def runge_kutta(rates: Rates, states: Array, before: Any, after: Any, steps: int) -> Array:
    """States after so many steps from some fractions to others."""
    h = (after - before) / steps
    for step in range(steps):
        start, end = before + step * h, after if step + 1 == steps else before + (step + 1) * h
        middle = (start + end) / 2
        first = rates(start, states)
        second = rates(middle, states + 0.5 * h * first)
        third = rates(middle, states + 0.5 * h * second)
        fourth = rates(end, states + h * third)
        states = states + h / 6.0 * (first + 2.0 * (second + third) + fourth)
    return states
