"""Types of arrays, for annotations, and arrays of numbers that a user gave."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Indices = NDArray[np.int64]


def finite_numbers(given: Any, label: str, refusal: type[Exception]) -> Array:
    """A user's numbers as an array; anything else, and numbers that are not finite, are refused."""
    try:
        numbers = np.array(given, dtype=float)
    except (TypeError, ValueError) as error:
        raise refusal(f"{label}: expected numbers: {error}.") from None
    if not np.isfinite(numbers).all():
        place = np.argwhere(~np.isfinite(numbers))[0].tolist()
        raise refusal(f"{label}: {numbers[tuple(place)]} at {place} is not finite. Leave it out, or give a number.")
    return numbers


def increasing_numbers(given: Any, label: str, refusal: type[Exception], fewest: int = 2) -> Array:
    """Finite numbers, each larger than the one before; others are refused."""
    numbers = finite_numbers(given, label, refusal)
    if numbers.ndim != 1 or len(numbers) < fewest:
        raise refusal(f"{label}: an array of shape {numbers.shape}; expected a list of at least {fewest} numbers.")
    for k in np.flatnonzero(np.diff(numbers) <= 0.0).tolist():
        raise refusal(
            f"{label}: must increase, but {numbers[k]:g} at {k} is followed by {numbers[k + 1]:g}. Sort them, and "
            "leave out those that are repeated."
        )
    return numbers
