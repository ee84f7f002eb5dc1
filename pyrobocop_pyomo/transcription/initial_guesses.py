"""Initial guesses: a constant, a function of time, or an array on the mesh, spread over a grid."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Union

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.modeling.rule_slips import number_at
from pyrobocop_pyomo.numerics import Array, Grid

InitialGuess = Union[float, Sequence[float], NDArray[np.float64], Callable[[float], float], None]  # noqa: UP007


def initial_state_values(guess: InitialGuess, grid: Grid, name: str) -> Array:
    """Values at every time of the grid.

    An array has either one value per time of the grid, or one per element boundary; the latter is
    interpolated linearly.

    Raises
    ------
    InitialGuessError
        On another length, or values that are not finite numbers.
    """
    boundaries, times = grid.mesh.boundaries, grid.times
    values = _values(guess, times, {len(times), len(boundaries)}, name, f"{len(boundaries)} element boundaries")
    return values if len(values) == len(times) else np.interp(times, boundaries, values)


def initial_stage_values(guess: InitialGuess, grid: Grid, name: str) -> Array:
    """Values at every collocation point; an array has one value per point, or one per element.

    Raises
    ------
    InitialGuessError
        On another length, or values that are not finite numbers.
    """
    elements, points = grid.mesh.elements, grid.points
    values = _values(guess, points, {len(points), elements}, name, f"{elements} elements")
    return values if len(values) == len(points) else values[[grid.element_of[time] for time in points]]


def initial_values_at(guess: InitialGuess, times: Sequence[float], name: str, expected: str) -> Array:
    """Values at given times; an array has one value for each.

    Parameters
    ----------
    expected : str
        What the times are, for the message: ``"12 elements"``.

    Raises
    ------
    InitialGuessError
        On another length, or values that are not finite numbers.
    """
    return _values(guess, times, {len(times)}, name, expected)


def initial_number(guess: InitialGuess, name: str) -> float:
    """A single number, for what does not change in time.

    Raises
    ------
    InitialGuessError
        When it is no finite number.
    """
    if callable(guess):
        raise InitialGuessError(f"{name}: the initial guess is a function of time, but '{name}' is one number.")
    return float(_values(guess, (0.0,), {1}, name, "one number")[0])


def _values(guess: InitialGuess, times: Sequence[float], lengths: set[int], name: str, expected: str) -> Array:
    try:
        if guess is None:
            values = np.zeros(len(times))
        elif callable(guess):
            what = f"{name}: the initial guess"
            values = np.array([float(number_at(guess, time, what, InitialGuessError)) for time in times])
        else:
            if np.asarray(guess).dtype.kind in "SU":
                raise TypeError("it is text")  # NumPy would read the number out of it
            values = np.asarray(guess, dtype=float)
    except (TypeError, ValueError) as error:
        raise InitialGuessError(f"{name}: the initial guess is not made of numbers ({error}).") from error
    if values.ndim == 0:
        values = np.full(len(times), float(values))
    if values.ndim != 1 or len(values) not in lengths:
        shape = f"{len(values)} values" if values.ndim == 1 else f"shape {values.shape}"
        needed = " or ".join(str(length) for length in sorted(lengths))
        raise InitialGuessError(
            f"{name}: the initial guess has {shape}; {expected} need {needed}. Give {needed} values, a number, "
            "or a function of time."
        )
    if not np.isfinite(values).all():
        i = int(np.flatnonzero(~np.isfinite(values))[0])
        raise InitialGuessError(
            f"{name}: value {i} of the initial guess is {values[i]}; initial guesses must be finite."
        )
    return values
