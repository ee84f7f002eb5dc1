"""Rows that formulas say for all times: the same at each, but for the variables."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Hashable, Iterable, Mapping
from functools import partial
from typing import Any

from pyomo.core.base.constraint import ConstraintData

from pyrobocop_pyomo.modeling.rows_by_rule import RepeatedSum, RowRule

from .slots import Slot


def by_label(indices: Iterable[Any], label_of: Callable[[Any], Hashable]) -> dict[Any, list[Any]]:
    """Indices of each label, in their order."""
    found: dict[Any, list[Any]] = {}
    for index in indices:
        found.setdefault(label_of(index), []).append(index)
    return found


class FormulaRows(RowRule):
    """Rows over times, of one or several labels.

    Parameters
    ----------
    rows : mapping of label to row
        At one time.
    """

    def __init__(self, rows: Mapping[Hashable, Any]) -> None:
        self._bounds = {label: _bounds_of(ConstraintData(row)) for label, row in rows.items()}

    @abstractmethod
    def parts(self, index: Any) -> tuple[float, Hashable]:
        """Time and label of a row."""

    @abstractmethod
    def slots(self, block: Any) -> Mapping[Hashable, list[Slot]]:
        """What the rows of each label read."""

    def bounds(self, index: Any) -> tuple[Any, Any]:
        """Those at any time."""
        return self._bounds[self.parts(index)[1]]

    def sums(self, block: Any, indices: list[Any]) -> list[RepeatedSum]:
        """One for each label."""
        slots, found = self.slots(block), []
        read: dict[Any, list[Any]] = {}  # rows of several labels read the same at the same times
        for label, positions in by_label(range(len(indices)), lambda i: self.parts(indices[i])[1]).items():
            of_label = [indices[position] for position in positions]
            times = [self.parts(index)[0] for index in of_label]
            moments = tuple(times)
            keys = [(slot, moments) for slot in slots[label]]
            read |= {key: key[0].at_all(block, times) for key in keys if key not in read}
            variables = [read[key] for key in keys]
            found.append(RepeatedSum(positions, [1.0] * len(times), variables, partial(self._body_at, block, of_label)))
        return found

    def _body_at(self, block: Any, indices: list[Any], place: int) -> Any:
        return ConstraintData(self(block, indices[place])).body


def _bounds_of(row: ConstraintData) -> tuple[Any, Any]:
    """Bounds of a row as it states them, None for infinite ones; twice the same where it is an equality."""
    stated = row.to_bounded_expression()[::2]
    lower, upper = (None if each.__class__ is float and math.isinf(each) else each for each in stated)
    return (lower, lower) if row.equality else (lower, upper)
