"""Data of a model that move along straight lines, or as a function says."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ModelError

from .named_data import by_component, data_members


class DataPath:
    """Puts the data of a position on a model.

    Parameters
    ----------
    model : Block
    path : mapping, iterable or callable
        As `homotopy` takes it.

    Raises
    ------
    ModelError
        If a component cannot move, or an end of a line is no number.
    """

    def __init__(self, model: Any, path: Any) -> None:
        self._lines: list[tuple[Any, float, float]] = []
        self._function = path if callable(path) else None
        if self._function is None:
            lines = by_component(path, model)
            if not lines:
                raise ModelError(f"'{model.name}': no parameters were given that could move.")
            for component, ends in lines:
                self._add(component, ends)
        self._before = [(each, each.value) for each, _, _ in self._lines]

    def put(self, position: float) -> None:
        """Put the data of a position between 0 and 1 on the model."""
        if self._function is not None:
            self._function(position)
        for component, first, last in self._lines:
            # Both ends exactly, whatever rounding does in between.
            component.set_value(last if position == 1.0 else first + position * (last - first))

    def restore(self) -> None:
        """Put back what was there before; of a function, nobody knows what it changed."""
        for component, number in self._before:
            component.set_value(number)

    def _add(self, component: Any, ends: Any) -> None:
        members = data_members(component)
        first, last = ends if isinstance(ends, (tuple, list)) and len(ends) == 2 else (None, ends)
        for member in members:
            now = value(member, exception=False)
            numbers = [_end(member, now if end is None else end) for end in (first, last)]
            if numbers[0] is not None and numbers[1] is not None:
                self._lines.append((member, numbers[0], numbers[1]))


def _end(member: Any, end: Any) -> float | None:
    """The number of a member; None where a mapping leaves it out, which keeps its value."""
    if isinstance(end, Mapping):
        end = end.get(member.index())
        if end is None:
            return None
    if isinstance(end, bool) or not isinstance(end, (int, float)) or not math.isfinite(end):
        raise ModelError(f"'{member.name}': an end of its path is {end!r}; expected a finite number.")
    return float(end)
