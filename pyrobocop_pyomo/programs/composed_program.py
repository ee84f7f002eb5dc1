"""A nonlinear program with Python functions in it: compiled expressions around functions that take many points at once.

The program is ``f(x, y)`` and ``g(x, y)``, where ``y = F(u(x, y))`` stands for the outputs of all calls. The variables
of the composition are x alone: y is eliminated level by level, since a call holds in its arguments only calls of lower
levels. With ``Y = dy/dx`` and ``U = du/dx`` along the elimination and the adjoints
``nu = f_y + g_y' lambda + u_y' mu`` and ``mu = F_u' nu``, the Hessian of the Lagrangian is::

    [I; Y]' (Hessian of f + lambda' g + mu' u by (x, y)) [I; Y]  +  sum over the calls  U' (nu' F_uu) U

Each evaluation calls each function once, for all points of a level together. The products are those of sparse matrices;
their entries are found once, from matrices whose entries are all one.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np
from pyomo.core.base.constraint import ConstraintData
from pyomo.core.base.var import VarData

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.modeling.functions import Function
from pyrobocop_pyomo.optional_imports import scipy

from .function_calls import FunctionCall
from .model_terms import ModelTerms
from .nonlinear_program import FloatArray, IndexArray, finite
from .summed_terms import SummedTerms
from .vectorised_program import VectorisedProgram

logger = logging.getLogger(__name__)


def vectorised_composition(
    terms: ModelTerms,
) -> tuple[VectorisedProgram | ComposedProgram, list[VarData], list[ConstraintData]]:
    """The program of a model whose expressions are evaluated by vectorised functions, its variables and its rows."""
    main = VectorisedProgram(terms)
    if not terms.calls.calls:
        return main, terms.variables, terms.constraints
    outputs = [variable for call in terms.calls.calls for variable in call.outputs.values()]
    of_calls = set(map(id, outputs))
    x = [variable for variable in terms.variables if id(variable) not in of_calls]
    place_of = {id(variable): place for place, variable in enumerate([*x, *outputs])}
    columns = np.array([place_of[id(variable)] for variable in terms.variables], dtype=np.intp)
    levels = [
        Level(arguments, _points(calls, place_of), columns, len(place_of))
        for calls, arguments in zip(terms.calls.levels, main.arguments, strict=True)
    ]
    return ComposedProgram(main, columns, len(x), len(outputs), levels), x, terms.constraints


@dataclass(frozen=True, eq=False)
class Points:
    """All calls of one function on one level.

    Attributes
    ----------
    function : Function
    rows : int array, shape (points, inputs)
        Rows of the level that are the arguments; each row is one argument.
    outputs : int array, shape (points, outputs)
        Places among all x and y, -1 for an output that nothing uses.
    """

    function: Function
    rows: np.ndarray
    outputs: np.ndarray

    def entries(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Which derivatives of outputs by inputs are used, and the outputs and the arguments of these."""
        outputs, arguments = np.broadcast_arrays(self.outputs[:, :, None], self.rows[:, None, :])
        used = outputs >= 0
        return used, outputs[used], arguments[used]


def _points(level: Sequence[FunctionCall], place_of: dict[int, int]) -> list[Points]:
    """The calls of each function together, with the rows of their arguments, which are in the order of the calls."""
    row = count()
    alike: dict[tuple[int, int], list[tuple[FunctionCall, list[int]]]] = {}
    for call in level:
        rows = [next(row) for _ in call.arguments]
        alike.setdefault((id(call.function), len(rows)), []).append((call, rows))
    found = []
    for several in alike.values():
        function = several[0][0].function
        outputs = [
            [place_of[id(call.outputs[i])] if i in call.outputs else -1 for i in range(function.output_count)]
            for call, _ in several
        ]
        found.append(Points(function, np.array([rows for _, rows in several], dtype=np.intp), np.array(outputs)))
    return found


class Level:
    """The arguments of calls that hold no other calls than those of lower levels, with derivatives as matrices.

    Parameters
    ----------
    arguments : SummedTerms
    points : list of Points
    columns : int array
        The places of the arguments' variables among all x and y.
    size : int
        Count of x and y.
    """

    def __init__(self, arguments: SummedTerms, points: list[Points], columns: np.ndarray, size: int) -> None:
        self.arguments, self.points, self._columns = arguments, points, columns
        self._shape = arguments.rows, size
        rows, by = arguments.structure
        self._entries = rows, columns[by]
        self._used, outputs, inputs = zip(*(each.entries() for each in points), strict=True)
        self._slopes = np.concatenate(outputs), np.concatenate(inputs)
        pairs = [np.broadcast_arrays(each.rows[:, :, None], each.rows[:, None, :]) for each in points]
        self._pairs = np.concatenate([np.reshape(both, (2, -1)) for both in pairs], axis=1)
        self.triangle = columns[np.array(arguments.hessian_structure)]

    def inputs(self, z: FloatArray) -> list[FloatArray]:
        """Arguments of the calls, one array for each function."""
        values = self.arguments.compiled.values(z[self._columns])
        rows = finite(values, "CasADi", "arguments of a Python function")
        return [rows[points.rows] for points in self.points]

    def first(self, z: FloatArray, inputs: Sequence[FloatArray]) -> tuple[Any, Any]:
        """Derivatives of the arguments by x and y, and of y by the arguments."""
        jacobians = [points.function.jacobians(X) for points, X in zip(self.points, inputs, strict=True)]
        slopes = [block[used] for block, used in zip(jacobians, self._used, strict=True)]
        entries = self.arguments.compiled.jacobian(z[self._columns])
        finite(entries, "CasADi", "Jacobian of the arguments of a Python function")
        return self._first(entries, np.concatenate(slopes))

    def second(
        self, z: FloatArray, inputs: Sequence[FloatArray], adjoint: FloatArray, of_rows: FloatArray
    ) -> tuple[FloatArray, Any]:
        """Second derivatives with adjoints: of the arguments, in the order of `triangle`, and of y by the arguments."""
        blocks = []
        for points, X in zip(self.points, inputs, strict=True):
            weights = np.where(points.outputs >= 0, adjoint[points.outputs], 0.0)
            blocks.append(np.einsum("po,poij->pij", weights, points.function.hessians(X)).ravel())
        entries = np.zeros(self.triangle[0].size)
        self.arguments.compiled.add_hessian(z[self._columns], of_rows, entries)
        finite(entries, "CasADi", "Hessian of the arguments of a Python function")
        return entries, self._second(np.concatenate(blocks))

    def patterns(self) -> tuple[tuple[Any, Any], tuple[FloatArray, Any]]:
        """The first and the second derivatives with ones in all entries."""
        sizes = (indices[0].size for indices in (self._entries, self._slopes, self.triangle, self._pairs))
        arguments, functions, triangle, pairs = map(np.ones, sizes)
        return self._first(arguments, functions), (triangle, self._second(pairs))

    def _first(self, arguments: FloatArray, functions: FloatArray) -> tuple[Any, Any]:
        return _matrix(arguments, self._entries, self._shape), _matrix(functions, self._slopes, self._shape[::-1])

    def _second(self, functions: FloatArray) -> Any:
        return _matrix(functions, self._pairs, (self._shape[0], self._shape[0]))


def _matrix(values: FloatArray, entries: Any, shape: tuple[int, int]) -> Any:
    return scipy.sparse.csr_array((values, tuple(entries)), shape=shape)


def _sorted(matrix: Any) -> Any:
    """A matrix whose entries stand row by row, in the order of the columns: places in it are found by bisection."""
    matrix = matrix.tocsr()
    matrix.sort_indices()
    return matrix


def _structure(pattern: Any) -> tuple[IndexArray, IndexArray]:
    """Rows and columns of the entries of a matrix without zeros."""
    rows, columns = _sorted(pattern).tocoo().coords
    return rows.astype(np.int32), columns.astype(np.int32)


def _values_at(structure: tuple[IndexArray, IndexArray], matrix: Any) -> FloatArray:
    """The values of a matrix at some places; products drop the zeros among them."""
    values = np.zeros(structure[0].size)
    if values.size:  # SciPy has another answer for none
        values[:] = _sorted(matrix)[structure]
    return values


class ComposedProgram:
    """See the module; a `NonlinearProgram` in x.

    Parameters
    ----------
    main : VectorisedProgram
        The objective and the rows, with variables that stand for the outputs of calls.
    columns : int array
        The places of its variables in the vector of x and y.
    n, outputs : int
        Counts of x and of y.
    levels : sequence of Level
        From the lowest on.
    """

    def __init__(
        self, main: VectorisedProgram, columns: np.ndarray, n: int, outputs: int, levels: Sequence[Level]
    ) -> None:
        self._main, self._columns, self._levels = main, columns, levels
        self.n, self.m, self._size = n, main.m, n + outputs
        self.g_multipliers_start: FloatArray | None = None
        rows, by = main.jacobian_structure
        self._main_entries = rows, columns[by]
        triangles = [columns[np.array(main.hessian_structure)], *(level.triangle for level in levels)]
        self._triangle = np.concatenate(triangles, axis=1)
        # Both triangles are made of the lower one, in which the diagonal stands for itself twice.
        self._halves = np.where(self._triangle[0] == self._triangle[1], 0.5, 1.0)
        firsts, seconds = zip(*(level.patterns() for level in levels), strict=True)
        by_x, of_arguments = self._eliminated(firsts)
        self.jacobian_structure = _structure(self._main_jacobian(np.ones(rows.size)) @ by_x)
        ones = np.ones(main.hessian_structure[0].size)
        self.hessian_structure = _structure(self._second(ones, seconds, by_x, of_arguments))
        self._z_at: FloatArray | None = None
        self._differentiated_at: FloatArray | None = None
        self.derivatives = _described(main.derivatives, [p.function for level in levels for p in level.points])
        self._read()
        self._check_derivatives()

    def refresh(self) -> None:
        """Read the numbers of the model again; see `VectorisedProgram.refresh`."""
        self._main.refresh()
        self._read()

    def _read(self) -> None:
        of_x = np.argsort(self._columns)[: self.n]
        main = self._main
        self.x_lower, self.x_upper, self.x_start = main.x_lower[of_x], main.x_upper[of_x], main.x_start[of_x]
        self.g_lower, self.g_upper = self._main.g_lower, self._main.g_upper
        self._z_at = self._differentiated_at = None

    def _check_derivatives(self) -> None:
        """Once for each function, at the first points of the model."""
        try:
            self._at(self.x_start)
        except EvaluationError as error:
            logger.warning("a Python function has no value at the first point of the model: %s", error)
            return
        for level, inputs in zip(self._levels, self._inputs, strict=True):
            for points, X in zip(level.points, inputs, strict=True):
                points.function.check_derivatives_once(X)

    # ---------------------------------------------------------------- evaluation

    def _at(self, x: FloatArray) -> FloatArray:
        """The variables of the main program."""
        if self._z_at is None or not np.array_equal(self._z_at, x):
            self._z_at = None
            z = np.zeros(self._size)
            z[: self.n] = x
            self._inputs = []
            for level in self._levels:
                inputs = level.inputs(z)
                self._inputs.append(inputs)
                for points, X in zip(level.points, inputs, strict=True):
                    used = points.outputs >= 0
                    z[points.outputs[used]] = points.function.values(X)[used]
            self._z, self._z_at = z, np.array(x)
        return self._z[self._columns]

    def _differentiate(self, x: FloatArray) -> FloatArray:
        """The same, with the first derivatives of y known."""
        main = self._at(x)
        if self._differentiated_at is None or not np.array_equal(self._differentiated_at, x):
            self._differentiated_at = None
            levels = zip(self._levels, self._inputs, strict=True)
            self._firsts = [level.first(self._z, inputs) for level, inputs in levels]
            self._by_x, self._of_arguments = self._eliminated(self._firsts)
            self._differentiated_at = np.array(x)
        return main

    def _eliminated(self, firsts: Iterable[tuple[Any, Any]]) -> tuple[Any, list[Any]]:
        """``[I; Y]``, and U of each level."""
        by_x, found = scipy.sparse.eye_array(self._size, self.n, format="csr"), []
        for arguments, functions in firsts:
            found.append(arguments @ by_x)
            by_x = by_x + functions @ found[-1]
        return by_x, found

    def _main_jacobian(self, values: FloatArray) -> Any:
        return _matrix(values, self._main_entries, (self.m, self._size))

    def objective(self, x: FloatArray) -> float:
        """Value of f."""
        return self._main.objective(self._at(x))

    def gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of f."""
        gradient = self._main.gradient(self._differentiate(x))
        return np.asarray(gradient @ self._by_x[self._columns])

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of g."""
        return self._main.constraints(self._at(x))

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Values of the Jacobian of g."""
        jacobian = self._main.jacobian(self._differentiate(x))
        return _values_at(self.jacobian_structure, self._main_jacobian(jacobian) @ self._by_x)

    def hessian(self, x: FloatArray, objective_factor: float, multipliers: FloatArray) -> FloatArray:
        """Values of the Hessian of the Lagrangian."""
        main = self._differentiate(x)
        adjoint = self._main_jacobian(self._main.jacobian(main)).T @ multipliers
        adjoint[self._columns] += objective_factor * self._main.gradient(main)
        seconds = []
        for level, inputs, (arguments, functions) in zip(
            reversed(self._levels), reversed(self._inputs), reversed(self._firsts), strict=True
        ):
            of_rows = functions.T @ adjoint
            seconds.append(level.second(self._z, inputs, adjoint, of_rows))
            adjoint += arguments.T @ of_rows
        values = self._main.hessian(main, objective_factor, multipliers)
        second = self._second(values, seconds[::-1], self._by_x, self._of_arguments)
        return _values_at(self.hessian_structure, second)

    def _second(
        self, main: FloatArray, seconds: Sequence[tuple[FloatArray, Any]], by_x: Any, of_arguments: Sequence[Any]
    ) -> Any:
        """The lower triangle of all second derivatives by x."""
        values = np.concatenate([main, *(of_rows for of_rows, _ in seconds)])
        found = by_x.T @ _matrix(self._halves * values, self._triangle, (self._size, self._size)) @ by_x
        for (_, by_arguments), slopes in zip(seconds, of_arguments, strict=True):
            found = found + slopes.T @ (0.5 * by_arguments) @ slopes
        return scipy.sparse.tril(found + found.T)


def _described(derivatives: str, functions: Sequence[Function]) -> str:
    """Where derivatives come from, with the functions named."""
    different = {id(function): function for function in functions}.values()
    words = []
    for function in different:
        differences = "" if function.has_hessian else " (second derivatives by differences)"
        words.append(f"'{function.name}'{differences}")
        if differences:
            logger.info("'%s' has no hessian: second derivatives are differences of its jacobian", function.name)
    return f"{derivatives}, with {', '.join(words)} in Python" if words else derivatives
