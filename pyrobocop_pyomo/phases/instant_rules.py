"""Formulas of rules that have to know the time as a number: asked at each instant, evaluated at all at once.

``min(1.0, 0.4 + 0.2 * t)``, ``if t < 2:`` and ``numpy.interp(t, times, values)`` have no answer for a time that is a
variable.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NoReturn

import numpy as np

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.expression_nodes import NUMPY_NAMES, comparisons
from pyrobocop_pyomo.modeling.functions import Function
from pyrobocop_pyomo.modeling.merged_expressions import MergedExpressions
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.numerics import Array

ARRAY_FUNCTIONS: dict[str, Any] = {
    **{name: getattr(np, numpy_name) for name, numpy_name in NUMPY_NAMES.items()},
    **comparisons(np.logical_and),
    "choose": np.where,
    "call": lambda output, *arguments: output.evaluate_arrays(arguments),
}
# Sets of instants whose formulas are kept, and at most so many instants are evaluated: some seconds.
_KEPT, _MOST = 64, 6_000


def formulas_by_instant(
    ask: Callable[[float], Sequence[Any]], samples: Sequence[float], index: Any, variables: Sequence[Any]
) -> list[Any]:
    """Formulas, as many as a rule gives, of a time that is a variable.

    Parameters
    ----------
    ask : callable
        From a time index to expressions of `variables`, always as many.
    samples : sequence of float
        Time indices; what the rule reads at none of them is not read.
    index : VarData
        Stands for the time index.
    variables : sequence of VarData
        What the expressions may hold.

    Raises
    ------
    Exception
        What the rule raises for numbers too.
    """
    asked = [ask(time) for time in samples]
    read = {id(variable) for given in asked for entry in given for variable in variables_in(entry)}
    inputs = [variable for variable in variables if id(variable) in read]
    return list(_InstantRule(ask, inputs, len(asked[0]))(index, *inputs))


class _InstantRule(Function):
    """A rule as a function of the time index and of what it reads."""

    def __init__(self, ask: Callable[[float], Sequence[Any]], inputs: Sequence[Any], outputs: int) -> None:
        super().__init__(_no_derivatives, _no_derivatives, outputs=outputs, name="rule", check_derivatives=False)
        self._ask, self._inputs = ask, list(inputs)
        self._instants = 0
        self._merged: dict[bytes, MergedExpressions] = {}
        self._last_points, self._last_values = np.empty((0, 0)), np.empty((0, outputs))

    def values(self, points: Array) -> Array:
        """Values at many points, shape (points, outputs); not finite where the formulas are not."""
        if np.array_equal(points, self._last_points, equal_nan=True):  # each output is requested by itself
            return self._last_values
        key = points[:, 0].tobytes()
        if key not in self._merged:
            if len(self._merged) == _KEPT:
                self._merged.clear()
            self._merged[key] = self._formulas(points[:, 0].tolist())
        columns = list(points[:, 1:].T)
        values = self._merged[key](columns, ARRAY_FUNCTIONS)
        self._last_points, self._last_values = points, values
        return values

    def _formulas(self, times: list[float]) -> MergedExpressions:
        asked: dict[float, Sequence[Any]] = {}
        self._instants += len(times)
        if self._instants > _MOST:
            raise TrajectoryError(f"a rule that has to know the time as a number would be asked over {_MOST} times.")
        for time in times:
            if time not in asked:
                asked[time] = self._ask(time)
            if len(asked[time]) != self.output_count:
                raise TrajectoryError(f"a rule gives {len(asked[time])} rows at t = {time:g}, not {self.output_count}.")
        return MergedExpressions([asked[time] for time in times], self._inputs)


def _no_derivatives(points: Array) -> NoReturn:
    raise NotImplementedError
