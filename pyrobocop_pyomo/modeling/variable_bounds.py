"""Bounds of many variables as arrays, read again where they have changed."""

from __future__ import annotations

from collections.abc import Iterable
from operator import attrgetter, is_not
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyomo.common.numeric_types import native_numeric_types

_VALUE = attrgetter("value")
# Behind Pyomo's properties, each of which takes a microsecond to find the tighter of the bound and the domain's.
_GIVEN = tuple(map(attrgetter, ("_lb", "_ub", "_domain")))


class VariableBounds:
    """How far variables are from their bounds.

    Parameters
    ----------
    variables : iterable of VarData

    Attributes
    ----------
    variables : list of VarData
        Those that have bounds when this is made.
    """

    def __init__(self, variables: Iterable[Any]) -> None:
        everything = list(variables)
        bounds = [variable.bounds for variable in everything]
        self.variables = [each for each, known in zip(everything, bounds, strict=True) if known != (None, None)]
        self._take([known for known in bounds if known != (None, None)])

    def violations(self) -> NDArray[np.float64]:
        """Of each variable at the value that it has now; 0 where it has none, infinite for NaN."""
        given = [list(map(read, self.variables)) for read in _GIVEN]
        if self._changes or any(any(map(is_not, now, then)) for now, then in zip(given, self._given, strict=True)):
            self._take([variable.bounds for variable in self.variables])
        numbers = list(map(_VALUE, self.variables))
        absent = np.array([number is None for number in numbers]) if None in numbers else None
        values = np.array(numbers, dtype=float)  # None becomes NaN
        violations = np.maximum(np.maximum(self._lower - values, values - self._upper), 0.0)
        violations[np.isnan(violations)] = np.inf
        if absent is not None:
            violations[absent] = 0.0
        return violations

    def sizes(self) -> NDArray[np.float64]:
        """Magnitude of each variable at the value that it has now, or 1 where that is larger."""
        values = np.array(list(map(_VALUE, self.variables)), dtype=float)
        return np.fmax(np.abs(values), 1.0)

    def _take(self, bounds: list[tuple[float | None, float | None]]) -> None:
        self._given = [list(map(read, self.variables)) for read in _GIVEN]
        known = {*native_numeric_types, type(None)}
        # An expression may change by itself.
        self._changes = any(bound.__class__ not in known for bounds in self._given[:2] for bound in bounds)
        self._lower = np.array([-np.inf if lower is None else lower for lower, _ in bounds], dtype=float)
        self._upper = np.array([np.inf if upper is None else upper for _, upper in bounds], dtype=float)
