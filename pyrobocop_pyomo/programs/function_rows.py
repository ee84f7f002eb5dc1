"""A nonlinear program with Python functions in it, each output of which is a variable that a row ties to the function.

Where an argument is no free variable, it has a variable too, which an ordinary row of the program ties to the
expression. So a call is ``y - F(a) = 0`` for all outputs ``y`` and arguments ``a``, whose derivatives are those of the
function, and a solver sees sparse rows wherever calls stand in each other's arguments.

Each evaluation calls each function once, for all of its points together.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import attrgetter

import numpy as np
from pyomo.core.base.constraint import ConstraintData

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.modeling.functions import Function

from .model_terms import FunctionCall, ModelTerms
from .nonlinear_program import FloatArray
from .summed_terms import merged_places
from .vectorised_program import VectorisedProgram
from .wrapped_programs import WrappedProgram

logger = logging.getLogger(__name__)


def vectorised_program(terms: ModelTerms) -> tuple[VectorisedProgram | ProgramWithFunctions, list[ConstraintData]]:
    """The program of a model whose expressions are evaluated by vectorised functions, and its rows."""
    main = VectorisedProgram(terms)
    if not terms.calls.calls:
        return main, terms.constraints
    alike: dict[tuple[int, int, int], list[FunctionCall]] = {}
    for call in terms.calls.by_level():
        alike.setdefault((call.level, id(call.function), len(call.inputs)), []).append(call)
    calls = list(alike.values())
    ties = [call.ties[output] for several in calls for call in several for output in sorted(call.ties)]
    return ProgramWithFunctions(main, terms, calls), [*terms.constraints, *ties]


@dataclass(frozen=True, eq=False)
class Points:
    """All calls of one function on one level.

    Attributes
    ----------
    level : int
        0 where no argument is an output of a call.
    function : Function
    inputs : int array, shape (points, inputs)
        Columns of the arguments.
    outputs : int array, shape (points, outputs)
        Columns, -1 for an output that nothing uses.
    used : bool array, shape (points, outputs)
        Which of the outputs have a column.
    rows : int array, shape (points, outputs)
        Rows that tie them to the function.
    """

    level: int
    function: Function
    inputs: np.ndarray
    outputs: np.ndarray
    used: np.ndarray
    rows: np.ndarray

    @property
    def columns(self) -> np.ndarray:
        """Columns of the outputs that are used, one after the other."""
        return np.asarray(self.outputs[self.used])

    def values(self, x: FloatArray) -> FloatArray:
        """Those outputs at the arguments of a point."""
        return np.asarray(self.function.values(x[self.inputs])[self.used])


def _points(calls: Sequence[FunctionCall], column_of: Mapping[int, int], first: int) -> Points:
    """Calls of one function; their rows count from a first one."""
    function = calls[0].function
    inputs = np.array([[column_of[id(variable)] for variable in call.inputs] for call in calls])
    outputs = np.array(
        [
            [column_of[id(call.outputs[i])] if i in call.outputs else -1 for i in range(function.output_count)]
            for call in calls
        ]
    )
    used = outputs >= 0
    rows = np.where(used, first - 1 + np.cumsum(used).reshape(used.shape), -1)
    return Points(calls[0].level, function, inputs, outputs, used, rows)


class ProgramWithFunctions(WrappedProgram):
    """See the module; a `NonlinearProgram`, whose last rows are those of the functions.

    Parameters
    ----------
    main : VectorisedProgram
        The objective and the other rows.
    terms : ModelTerms
        What it was made from.
    calls : sequence of sequence of FunctionCall
        Those of one function on one level together, from the lowest level on.
    """

    def __init__(self, main: VectorisedProgram, terms: ModelTerms, calls: Sequence[Sequence[FunctionCall]]) -> None:
        super().__init__(main)
        self._main, column_of = main, terms.columns.column_of
        self._points: list[Points] = []
        for several in calls:
            self._points.append(_points(several, column_of, self.m))
            self.m += sum(len(call.outputs) for call in several)
        self._outputs = np.concatenate([each.columns for each in self._points])
        self._held = np.array([column_of[id(variable)] for variable in terms.calls.held], dtype=np.intp)
        ties = np.stack([np.arange(main.m, self.m), self._outputs])
        slopes, bends = zip(*map(_structures, self._points), strict=True)
        rows, columns = np.concatenate([np.stack(main.jacobian_structure), ties, *slopes], axis=1).astype(np.int32)
        self.jacobian_structure = rows, columns
        self.hessian_structure, self._place_in_hessian = merged_places([main.hessian_structure, *bends], self.n)
        self.derivatives = _described(main.derivatives, [each.function for each in self._points])
        self._read()
        self._check_derivatives()

    def refresh(self) -> None:
        """Read the numbers of the model again; see `VectorisedProgram.refresh`."""
        self._main.refresh()
        self._read()

    def _read(self) -> None:
        main, zeros = self._main, np.zeros(self.m - self._main.m)
        self.g_lower, self.g_upper = (np.concatenate([of, zeros]) for of in (main.g_lower, main.g_upper))
        self.x_start = self.completed(main.x_start)

    def _check_derivatives(self) -> None:
        """Once for each function, at the first points of the model."""
        for points in self._points:
            try:
                points.function.values(self.x_start[points.inputs])
            except EvaluationError as error:
                logger.warning("a Python function has no value at the first point of the model: %s", error)
                return
            points.function.check_derivatives_once(self.x_start[points.inputs])

    def completed(self, x: FloatArray) -> FloatArray:
        """A point with all arguments and outputs as the other variables make them, as far as they have values.

        Parameters
        ----------
        x : float array, shape (n,)
        """
        x, main = np.array(x), self._main
        for _, several in groupby(self._points, attrgetter("level")):
            # The row of an argument is that of its variable less what it is to be; what it was may have no number.
            x[self._held] = 0.0
            x[self._held] = (main.g_lower - main.rows.values(x))[main.m - self._held.size :]
            for points in several:
                try:
                    x[points.columns] = points.values(x)
                except EvaluationError:
                    return x
        return x

    # ---------------------------------------------------------------- evaluation

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of g."""
        of_functions = np.concatenate([points.values(x) for points in self._points])
        return np.concatenate([self._main.constraints(x), x[self._outputs] - of_functions])

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Values of the Jacobian of g."""
        slopes = [-points.function.jacobians(x[points.inputs])[points.used].ravel() for points in self._points]
        return np.concatenate([self._main.jacobian(x), np.ones(self._outputs.size), *slopes])

    def hessian(self, x: FloatArray, objective_factor: float, multipliers: FloatArray) -> FloatArray:
        """Values of the Hessian of the Lagrangian."""
        values = [self._main.hessian(x, objective_factor, multipliers[: self._main.m])]
        for points in self._points:
            weights = np.where(points.used, multipliers[points.rows], 0.0)
            bends = np.einsum("po,poij->pij", -weights, points.function.hessians(x[points.inputs]))
            i, j = np.tril_indices(points.inputs.shape[1])
            values.append(bends[:, i, j].ravel())
        total = np.zeros(self.hessian_structure[0].size)
        np.add.at(total, self._place_in_hessian, np.concatenate(values))
        return total


def _structures(points: Points) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Rows and columns of the derivatives of outputs by arguments, and of the lower triangle by arguments twice."""
    rows, columns = np.broadcast_arrays(points.rows[:, :, None], points.inputs[:, None, :])
    i, j = np.tril_indices(points.inputs.shape[1])
    first, second = points.inputs[:, i].ravel(), points.inputs[:, j].ravel()
    slopes = np.stack([rows[points.used], columns[points.used]]).reshape(2, -1)
    return slopes, (np.maximum(first, second), np.minimum(first, second))


def _described(derivatives: str, functions: Sequence[Function]) -> str:
    """Where derivatives come from, with the functions named."""
    different = {id(function): function for function in functions}.values()
    words = [
        f"'{function.name}'{'' if function.has_hessian else ' (second derivatives by differences)'}"
        for function in different
    ]
    return f"{derivatives}, with {', '.join(words)} in Python"
