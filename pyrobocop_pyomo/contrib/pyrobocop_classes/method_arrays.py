"""The arrays that methods of a problem class get: variables to read, and rows to fill."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from pyrobocop_pyomo.modeling.expression_arrays import ArrayEntry, ExpressionArray, array


class ColumnArray(ExpressionArray):
    """Variables of one kind at one point, shape ``(n,)``.

    Authors write ``x[0]`` or ``x[0, 0]``: a second index chooses a column, of which there is one, or one per point of
    the first element for the initial state of a Mayer term.
    """

    columns: Any = None

    def __array_finalize__(self, source: Any) -> None:
        self.columns = None  # of a slice or a result, nothing is known

    def __getitem__(self, key: Any) -> Any:
        if self.ndim != 1 or not isinstance(key, tuple) or len(key) != 2 or None in key:
            return super().__getitem__(key)
        columns = np.asarray(self)[:, None] if self.columns is None else self.columns
        chosen = columns[key]
        return chosen.view(ExpressionArray) if isinstance(chosen, np.ndarray) else chosen


def column_array(values: Iterable[Any]) -> ColumnArray:
    """An array of variables, or of numbers in their place."""
    return array([ArrayEntry(value) for value in values]).view(ColumnArray)


class ArrayToFill(ExpressionArray):
    """Zeros that a method fills in place; one column also takes a vector."""

    @classmethod
    def zeros(cls, *shape: int) -> ArrayToFill:
        """All entries 0.0."""
        return np.full(shape, 0.0, dtype=object).view(cls)

    def __setitem__(self, key: Any, entry: Any) -> None:
        given: Any = array(entry)
        shape = np.shape(np.asarray(self)[key])
        super().__setitem__(key, given.reshape(shape) if given.size == np.prod(shape) else given)
