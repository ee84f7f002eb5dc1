"""Of which size the sides of pairs are: a product of 1e-8 says nothing of sides of 1e-4."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.complementarity import CanonicalPair
from pyrobocop_pyomo.modeling.expression_bounds import ExpressionBounds

# Below, a side is zero and not small: what a relaxation leaves of it.
SMALLEST_SIZE = 1e-6
# Runs with the smallest parameters leave less than this of zero.
_LEFT_OF_ZERO = 1e-8


class SideSizes:
    """Sizes by component: the sides of a contact over time are of one size, also where it is closed.

    Parameters
    ----------
    pairs : sequence of CanonicalPair
    start : float array, shape (pairs, 2)
        Values of the sides at the start. They count as well: at the answer all sides of a component may be zero.
    """

    def __init__(self, pairs: Sequence[CanonicalPair], start: NDArray[np.float64]) -> None:
        components = [id(pair.source.parent_component()) for pair in pairs]
        self._pairs = pairs
        self._groups = np.unique(np.array(components, dtype=np.int64), return_inverse=True)[1].ravel()
        self._start = start

    def at(self, sides: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sizes of the sides at a point, shape (pairs, 2): at most 1, so that no tolerance becomes larger.

        Parameters
        ----------
        sides : float array, shape (pairs, 2)
            Their values there.
        """
        sizes = self._largest(sides)
        return np.where(sizes < SMALLEST_SIZE, 1.0, np.minimum(sizes, 1.0))

    def too_small(self, sides: NDArray[np.float64], tolerance: float) -> NDArray[np.bool_]:
        """The pairs that are met if their sides are zero, and are not if these are small, shape (pairs,).

        Parameters
        ----------
        sides : float array, shape (pairs, 2)
        tolerance : float
            Of the smaller side, relative to its size.
        """
        sizes = self._largest(sides)
        small = (sizes > _LEFT_OF_ZERO) & (sizes < SMALLEST_SIZE)
        # What bounds keep as small as that is small all the same, as a force is in units of large masses.
        for place, side in np.argwhere(sizes <= _LEFT_OF_ZERO).tolist():
            pair = self._pairs[place]
            _, most = ExpressionBounds(use_fixed_var_values_as_bounds=True).walk_expression((pair.a, pair.b)[side])
            if 0.0 < most < SMALLEST_SIZE:
                sizes[place, side], small[place, side] = most, True
        relative = sides / np.where(small, sizes, self.at(sides))
        return small.any(axis=1) & (relative.min(axis=1) > tolerance)

    def _largest(self, sides: NDArray[np.float64]) -> NDArray[np.float64]:
        """Of the component, at the start or at the point, shape (pairs, 2)."""
        largest = np.zeros((int(self._groups.max(initial=-1)) + 1, 2))
        for values in (self._start, sides):
            np.maximum.at(largest, self._groups, np.abs(np.nan_to_num(values, posinf=1.0, neginf=-1.0)))
        return largest[self._groups]
