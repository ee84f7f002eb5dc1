"""Stiff differential equations over many elements at once, by an implicit Runge-Kutta method.

Where the explicit method of `flows` would need steps that are too small, a Radau method of five stages takes large
ones: it damps what decays fast, whatever the step. Its equations are solved by Newton's method for all elements side
by side, with slopes by differences at the start of each step.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import pairwise

import numpy as np

from .arrays import Array
from .families import radau
from .schemes import Scheme

# (local fraction, states of shape (n, k, N)) -> derivatives by the local fraction, of the same shape.
Rates = Callable[[float, Array], Array]

_STAGES = 5
# Steps between two fractions, doubled from the first number up to the last.
_FIRST_STEPS, _MOST_STEPS = 1, 32
# Implicit steps are dear: this tolerance is not undercut. With halved steps the error is such a part of the change.
_SMALLEST_TOLERANCE, _PART_OF_CHANGE = 1e-8, 1 / 8
# With the most steps this much is good enough; where so many steps leave so much, the equations are not smooth.
_GOOD_ENOUGH, _HOPELESS_STEPS, _HOPELESS = 1e-6, 16, 1e-2
# Of Newton's method, relative to the scales and to the tolerance of the integration.
_NEWTON_STEPS, _NEWTON_TOLERANCE, _SLOW, _DIFFERENCE = 20, 1e-3, 0.2, 1e-7
# Numbers in the matrices of one step: larger systems are left to others.
_MOST_NUMBERS = 20_000_000


@cache
def _scheme() -> Scheme:
    return radau(_STAGES)


def march_implicitly(
    rates: Rates, starts: Array, scales: Array, fractions: Array, tolerance: float
) -> tuple[Array, float] | None:
    """States at the fractions, with halved steps until they no longer change.

    Parameters
    ----------
    rates : callable
    starts : array, shape (n, k, N)
        Of ``k`` variants of ``N`` elements.
    scales : array, shape (n,)
        Sizes of the states.
    fractions : array, shape (f,)
        Where in each element states are wanted, from 0 to 1.
    tolerance : float
        Relative to the scales; 1e-8 where it is less.

    Returns
    -------
    (paths, error) or None
        ``paths`` of shape ``(f, n, k, N)``, and the estimated error relative to the scales; None where it is
        above the tolerance and above a millionth.
    """
    n, k, count = starts.shape
    if (n * _STAGES) ** 2 * k * count > _MOST_NUMBERS:
        return None
    tolerance = max(tolerance, _SMALLEST_TOLERANCE)
    steps, coarse = _FIRST_STEPS, None
    with np.errstate(all="ignore"):
        while steps <= _MOST_STEPS:
            fine = _march(rates, starts, scales, fractions, steps, _NEWTON_TOLERANCE * tolerance)
            if fine is not None and coarse is not None:
                error = _PART_OF_CHANGE * float((np.abs(fine - coarse).max(axis=(0, 2, 3)) / scales).max())
                if error <= (tolerance if steps < _MOST_STEPS else max(tolerance, _GOOD_ENOUGH)):
                    return fine, error
                if steps >= _HOPELESS_STEPS and error > _HOPELESS:
                    return None
            steps, coarse = 2 * steps, fine
    return None


def _march(rates: Rates, states: Array, scales: Array, fractions: Array, steps: int, tolerance: float) -> Array | None:
    paths = [states]
    for before, after in pairwise(fractions.tolist()):
        h = (after - before) / steps
        for step in range(steps):
            following = _step(rates, before + step * h, h, states, scales, tolerance)
            if following is None:
                return None
            states = following
        paths.append(states)
    return np.array(paths)


def _step(rates: Rates, start: float, h: float, states: Array, scales: Array, tolerance: float) -> Array | None:
    """One step of every element; the unknowns are what each stage adds to the states, shape (s, n, k, N)."""
    scheme = _scheme()
    weights = h * scheme.A
    times = [min(start + fraction * h, 1.0) for fraction in scheme.c.tolist()]
    added = np.zeros((_STAGES, *states.shape))
    inverse = _inverse(weights, [_slopes(rates, times[-1], states, scales)] * _STAGES)
    before = np.inf
    for _ in range(_NEWTON_STEPS):
        if inverse is None:
            return None
        left = np.einsum("ij,javm->iavm", weights, [rates(t, states + dy) for t, dy in zip(times, added, strict=True)])
        change = _times(inverse, left - added)
        added = added + change
        size = float((np.abs(change).max(axis=(0, 2, 3)) / scales).max())
        if not np.isfinite(size):
            return None
        # Beside rounding, what is left does not shrink any more.
        if size <= tolerance or (before <= 1e2 * tolerance and size > _SLOW * before):
            return states + added[-1]
        if size > _SLOW * before or size > 1.0:  # slopes at the start say too little of the stages
            places = zip(times, added, strict=True)
            inverse = _inverse(weights, [_slopes(rates, t, states + dy, scales) for t, dy in places])
        before = size
    return None


def _inverse(weights: Array, slopes: list[Array]) -> Array | None:
    """Of the matrices of Newton's method, shape (k, N, s n, s n); None where one is singular."""
    n, _, k, count = slopes[0].shape
    products = np.einsum("ij,jabvm->vmiajb", weights, np.array(slopes))
    matrices = np.eye(_STAGES * n) - products.reshape(k, count, _STAGES * n, _STAGES * n)
    if not np.isfinite(matrices).all():
        return None
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        return None


def _times(inverse: Array, left: Array) -> Array:
    """The inverse applied to what is left, shape (s, n, k, N)."""
    s, n, k, count = left.shape
    found = inverse @ left.transpose(2, 3, 0, 1).reshape(k, count, s * n, 1)
    return np.ascontiguousarray(found.reshape(k, count, s, n).transpose(2, 3, 0, 1))


def _slopes(rates: Rates, time: float, states: Array, scales: Array) -> Array:
    """Derivatives of the rates by the states, by differences: shape (rates, states, k, N)."""
    n, k, count = states.shape
    step = _DIFFERENCE * np.maximum(scales[:, None, None], np.abs(states))
    varied = np.repeat(states[:, None], n + 1, axis=1)
    for j in range(n):
        varied[j, j + 1] += step[j]
    found = rates(min(time, 1.0), varied.reshape(n, (n + 1) * k, count)).reshape(n, n + 1, k, count)
    return (found[:, 1:] - found[:, :1]) / step[None]
