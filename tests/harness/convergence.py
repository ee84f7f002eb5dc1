"""Measuring the order of convergence."""

from collections.abc import Sequence

import numpy as np


def observed_order(meshes: Sequence[int], errors: Sequence[float], rounding_floor: float) -> float:
    """Slope of log(error) over log(width), by regression on the meshes before the first that reaches rounding.

    Raises
    ------
    AssertionError
        With fewer than three meshes above the floor: two points fit any line.
    """
    logarithms = []
    for elements, error in zip(meshes, errors, strict=True):
        if error <= rounding_floor:
            break
        logarithms.append((-np.log(elements), np.log(error)))
    assert len(logarithms) >= 3, f"only {len(logarithms)} of the errors {errors} lie above {rounding_floor}"
    widths, heights = np.array(logarithms).T
    return float(np.polyfit(widths, heights, 1)[0])
