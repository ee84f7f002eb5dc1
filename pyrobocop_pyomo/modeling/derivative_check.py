"""Derivatives against differences, at many points at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.errors import EvaluationError, FunctionError

FloatArray = NDArray[np.float64]

# The third root of the rounding error: where truncation and rounding of a central difference are alike.
_STEP = 6.0e-6
_TOLERANCE = 1e-4


def central_differences(function: Callable[[FloatArray], FloatArray], points: FloatArray) -> FloatArray:
    """Derivatives of an array-valued function, the last axis by inputs; all points and inputs in one call.

    Parameters
    ----------
    function : callable
        From points, shape (points, inputs), to an array of shape (points, ...).
    points : float array, shape (points, inputs)
    """
    count, inputs = points.shape
    steps = _STEP * np.maximum(1.0, np.abs(points))
    # What is added is rounded: the difference is taken over what really stands between the points.
    moved = np.repeat(points[None], 2 * inputs, axis=0)
    for i in range(inputs):
        moved[i, :, i] += steps[:, i]
        moved[inputs + i, :, i] -= steps[:, i]
    found = function(moved.reshape(-1, inputs))
    found = found.reshape(2 * inputs, count, *found.shape[1:])
    widths = np.stack([moved[i, :, i] - moved[inputs + i, :, i] for i in range(inputs)])
    quotients = (found[:inputs] - found[inputs:]) / widths.reshape(inputs, count, *[1] * (found.ndim - 2))
    return np.moveaxis(quotients, 0, -1)


def check_against_differences(
    owner: Any,
    function: Callable[[FloatArray], FloatArray],
    derivative: Callable[[FloatArray], FloatArray],
    points: FloatArray,
    label: str,
) -> None:
    """Compare what is given as a derivative with differences, input by input.

    Parameters
    ----------
    owner : Function
        Knows the words for a message.
    function, derivative : callable
        From points to arrays of shapes (points, outputs, ...) and (points, outputs, ..., inputs).
    points : float array, shape (points, inputs)
    label : str
        Name of the derivative, for a message.

    Raises
    ------
    FunctionError
        Naming output, inputs, point and both numbers.
    """
    here, given = function(points), derivative(points)
    steps = _STEP * np.maximum(1.0, np.abs(points))
    for i in range(points.shape[1]):
        try:
            forward, backward = (_quotient(function, here, points, i, sign * steps[:, i]) for sign in (1.0, -1.0))
            nearer = sum(_quotient(function, here, points, i, sign * steps[:, i] / 2) / 2 for sign in (1.0, -1.0))
        except (EvaluationError, FunctionError):
            continue  # beyond the edge of the domain there is nothing to compare with
        central = (forward + backward) / 2
        rounding = 1e4 * np.finfo(float).eps * np.abs(here).max(initial=0.0) / steps[:, i].min()
        sizes = np.maximum(np.abs(given[..., i]), np.abs(central))
        # Where both sides differ there is a kink, and where half the step makes a difference one of a derivative.
        allowed = _TOLERANCE * sizes + np.abs(forward - backward) + 10 * np.abs(central - nearer) + rounding
        wrong = np.abs(given[..., i] - central) > allowed
        if wrong.any():
            point, output, *inner = np.argwhere(wrong)[0]
            inputs = " and ".join(owner.input_name(k) for k in (*inner, i))
            raise FunctionError(
                f"'{owner.output_name(output)}': {label} gives {given[(point, output, *inner, i)]:.8g} as the "
                f"derivative by {inputs} at {owner.described(points[point])}; differences give "
                f"{central[(point, output, *inner)]:.8g}. Correct {label}; check_derivatives=False trusts it as it is."
            )


def _quotient(
    function: Callable[[FloatArray], FloatArray], here: FloatArray, points: FloatArray, i: int, step: FloatArray
) -> FloatArray:
    moved = points.copy()
    moved[:, i] += step
    width = moved[:, i] - points[:, i]
    return np.asarray((function(moved) - here) / width.reshape(-1, *[1] * (here.ndim - 1)))
