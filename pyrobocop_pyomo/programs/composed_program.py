"""A nonlinear program with Python functions in it: compiled expressions around functions that take many points at once.

The program is ``f(x, y)`` and ``g(x, y)``, where ``y = F(u(x, y))`` stands for the outputs of all calls. The variables
of the composition are x alone: y is eliminated level by level, since a call holds in its arguments only calls of lower
levels, so that as many repetitions as there are levels make derivatives and adjoints complete. With ``Y = dy/dx`` and
``U = du/dx`` along the elimination and the adjoints
``nu = f_y + g_y' lambda + u_y' mu`` and ``mu = F_u' nu``, the Hessian of the Lagrangian is::

    [I; Y]' (Hessian of f + lambda' g + mu' u by (x, y)) [I; Y]  +  sum over the calls  U' (nu' F_uu) U

Each evaluation calls each function once, for all points of a level together. The products are those of sparse matrices
whose entries stay where they are.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count, groupby
from operator import attrgetter

import numpy as np
from pyomo.core.base.constraint import ConstraintData
from pyomo.core.base.var import VarData

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.modeling.functions import Function

from .model_terms import FunctionCall, ModelTerms
from .nonlinear_program import FloatArray, IndexArray, finite
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
    points = _points(terms.calls.by_level(), place_of)
    return ComposedProgram(main, columns, len(x), len(outputs), points), x, terms.constraints


@dataclass(frozen=True, eq=False)
class Points:
    """All calls of one function on one level.

    Attributes
    ----------
    level : int
    function : Function
    rows : int array, shape (points, inputs)
        Rows of all arguments that are its own; each row is one argument.
    outputs : int array, shape (points, outputs)
        Places among all x and y, -1 for an output that nothing uses.
    """

    level: int
    function: Function
    rows: np.ndarray
    outputs: np.ndarray

    def entries(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Which derivatives of outputs by inputs are used, and the outputs and the arguments of these."""
        outputs, arguments = np.broadcast_arrays(self.outputs[:, :, None], self.rows[:, None, :])
        used = outputs >= 0
        return used, outputs[used], arguments[used]


def _points(calls: Sequence[FunctionCall], place_of: dict[int, int]) -> list[Points]:
    """The calls of each function on each level together, with the rows of their arguments, which are in their order."""
    row = count()
    alike: dict[tuple[int, int, int], list[tuple[FunctionCall, list[int]]]] = {}
    for call in calls:
        rows = [next(row) for _ in call.arguments]
        alike.setdefault((call.level, id(call.function), len(rows)), []).append((call, rows))
    found = []
    for (level, *_), several in alike.items():
        function = several[0][0].function
        outputs = [
            [place_of[id(call.outputs[i])] if i in call.outputs else -1 for i in range(function.output_count)]
            for call, _ in several
        ]
        rows_of_all = np.array([rows for _, rows in several], dtype=np.intp)
        found.append(Points(level, function, rows_of_all, np.array(outputs)))
    return found


class _Product:
    """The product of two sparse matrices whose entries stay where they are: which of them meet is found once.

    Parameters
    ----------
    left, right : int arrays, shape (2, entries)
        Rows and columns of their entries.

    Attributes
    ----------
    structure : int array, shape (2, entries)
        Rows and columns of the entries of the product, row by row.
    """

    def __init__(self, left: np.ndarray, right: np.ndarray) -> None:
        order = np.argsort(right[0], kind="stable")
        first, after = (np.searchsorted(right[0][order], left[1], side) for side in ("left", "right"))
        counts = after - first
        self._left = np.repeat(np.arange(counts.size), counts)
        place = np.arange(self._left.size) - np.repeat(np.cumsum(counts) - counts, counts)
        self._right = order[first[self._left] + place]
        self.structure, self._target = _merged(np.stack([left[0][self._left], right[1][self._right]]))

    def values(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """The entries of the product, from those of both."""
        return _sums(self._target, left[self._left] * right[self._right], self.structure.shape[1])


def _merged(entries: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The different ones of some entries, row by row, and which of these each of them is."""
    width = int(entries[1].max(initial=0)) + 1
    keys, number = np.unique(entries[0] * width + entries[1], return_inverse=True)
    return np.stack([keys // width, keys % width]), number


def _transposed_times(entries: np.ndarray, values: FloatArray, vector: FloatArray, size: int) -> FloatArray:
    """The product of a transposed matrix with a vector."""
    return _sums(entries[1], values * vector[entries[0]], size)


def _sums(places: np.ndarray, values: FloatArray, size: int) -> FloatArray:
    """What is added up at each place."""
    return np.bincount(places, values, minlength=size).astype(float, copy=False)


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
    points : list of Points
        From the lowest level on.
    """

    def __init__(
        self, main: VectorisedProgram, columns: np.ndarray, n: int, outputs: int, points: Sequence[Points]
    ) -> None:
        self._main, self._columns, self._points = main, columns, points
        self._levels = [list(several) for _, several in groupby(points, attrgetter("level"))]
        self.n, self.m, self._size = n, main.m, n + outputs
        self._main_entries, self._argument_entries = (
            np.stack([rows, columns[by]]) for rows, by in (main.jacobian_structure, main.arguments.structure)
        )
        self._used, slopes, inputs = zip(*(each.entries() for each in points), strict=True)
        self._slopes = np.stack([np.concatenate(slopes), np.concatenate(inputs)])
        # Derivatives of x by x, and of y by x: as many repetitions as there are levels have all of their entries.
        by_x = of_x = np.stack([np.arange(n)] * 2)
        for _ in range(len(self._levels) + 1):
            self._to_arguments = _Product(self._argument_entries, by_x)
            self._to_outputs = _Product(self._slopes, self._to_arguments.structure)
            by_x = np.concatenate([of_x, self._to_outputs.structure], axis=1)
        self._by_x_entries, self._to_rows = by_x, _Product(self._main_entries, by_x)
        pairs = [np.broadcast_arrays(each.rows[:, :, None], each.rows[:, None, :]) for each in points]
        triangle = columns[np.concatenate([main.hessian_structure, main.arguments.hessian_structure], axis=1)]
        # Both triangles are made of the lower one, in which the diagonal stands for itself twice.
        self._halves = np.where(triangle[0] == triangle[1], 0.5, 1.0)
        self._curvatures = [
            _Curvature(triangle, by_x),
            _Curvature(
                np.concatenate([np.reshape(both, (2, -1)) for both in pairs], axis=1), self._to_arguments.structure
            ),
        ]
        self.jacobian_structure: tuple[IndexArray, IndexArray] = tuple(self._to_rows.structure.astype(np.int32))
        lower = np.concatenate([each.lower for each in self._curvatures], axis=1)
        structure, self._place_in_hessian = _merged(lower)
        self.hessian_structure: tuple[IndexArray, IndexArray] = tuple(structure.astype(np.int32))
        self._z_at: FloatArray | None = None
        self._differentiated_at: FloatArray | None = None
        self.derivatives = _described(main.derivatives, [each.function for each in points])
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
        for points, X in zip(self._points, self._inputs, strict=True):
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
                rows = self._main.arguments.values(z[self._columns])
                for points in level:
                    X = finite(rows[points.rows], "CasADi", "arguments of a Python function")
                    self._inputs.append(X)
                    used = points.outputs >= 0
                    z[points.outputs[used]] = points.function.values(X)[used]
            self._z, self._z_at = z, np.array(x)
        return self._z[self._columns]

    def _differentiate(self, x: FloatArray) -> FloatArray:
        """The same, with the first derivatives of y known."""
        main = self._at(x)
        if self._differentiated_at is None or not np.array_equal(self._differentiated_at, x):
            self._differentiated_at = None
            jacobians = [points.function.jacobians(X) for points, X in zip(self._points, self._inputs, strict=True)]
            slopes = [block[used] for block, used in zip(jacobians, self._used, strict=True)]
            entries = self._main.arguments.jacobian(main)
            finite(entries, "CasADi", "Jacobian of the arguments of a Python function")
            self._eliminate(entries, np.concatenate(slopes))
            self._differentiated_at = np.array(x)
        return main

    def _eliminate(self, arguments: FloatArray, functions: FloatArray) -> None:
        """Know derivatives of the arguments by x and y, of y by the arguments, and from these ``[I; Y]`` and U."""
        self._by_z, self._by_arguments = arguments, functions
        self._by_x = np.zeros(self._by_x_entries.shape[1])
        self._by_x[: self.n] = 1.0
        for _ in self._levels:
            self._of_arguments = self._to_arguments.values(arguments, self._by_x)
            self._by_x[self.n :] = self._to_outputs.values(functions, self._of_arguments)

    def objective(self, x: FloatArray) -> float:
        """Value of f."""
        return self._main.objective(self._at(x))

    def gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of f."""
        by_z = np.zeros(self._size)
        by_z[self._columns] = self._main.gradient(self._differentiate(x))
        return _transposed_times(self._by_x_entries, self._by_x, by_z, self.n)

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of g."""
        return self._main.constraints(self._at(x))

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Values of the Jacobian of g."""
        jacobian = self._main.jacobian(self._differentiate(x))
        return self._to_rows.values(jacobian, self._by_x)

    def hessian(self, x: FloatArray, objective_factor: float, multipliers: FloatArray) -> FloatArray:
        """Values of the Hessian of the Lagrangian."""
        main = self._differentiate(x)
        own = _transposed_times(self._main_entries, self._main.jacobian(main), multipliers, self._size)
        own[self._columns] += objective_factor * self._main.gradient(main)
        adjoint = own
        for _ in self._levels:
            of_rows = _transposed_times(self._slopes, self._by_arguments, adjoint, self._main.arguments.rows)
            adjoint = own + _transposed_times(self._argument_entries, self._by_z, of_rows, self._size)
        blocks = []
        for points, X in zip(self._points, self._inputs, strict=True):
            weights = np.where(points.outputs >= 0, adjoint[points.outputs], 0.0)
            blocks.append(np.einsum("po,poij->pij", weights, points.function.hessians(X)).ravel())
        values = np.zeros(self._halves.size)
        of_main, of_arguments = np.split(values, [self._main.hessian_structure[0].size])
        of_main[:] = self._main.hessian(main, objective_factor, multipliers)
        self._main.arguments.add_hessian(main, of_rows, of_arguments)
        finite(of_arguments, "CasADi", "Hessian of the arguments of a Python function")
        of_expressions, of_functions = self._curvatures
        terms = (
            of_expressions.values(self._halves * values, self._by_x),
            of_functions.values(0.5 * np.concatenate(blocks), self._of_arguments),
        )
        return _sums(self._place_in_hessian, np.concatenate(terms), self.hessian_structure[0].size)


class _Curvature:
    """The lower triangle of ``S' (H + H') S``, for matrices H and S whose entries stay where they are.

    Parameters
    ----------
    of : int array, shape (2, entries)
        Rows and columns of H.
    by_x : int array, shape (2, entries)
        Rows and columns of S.

    Attributes
    ----------
    lower : int array, shape (2, entries)
        Rows and columns of the triangle's entries, some of them in two parts.
    """

    def __init__(self, of: np.ndarray, by_x: np.ndarray) -> None:
        self._first = _Product(of, by_x)
        self._second = _Product(by_x[::-1], self._first.structure)
        structure = self._second.structure
        self.lower = np.stack([structure.max(axis=0), structure.min(axis=0)])
        self._times = np.where(structure[0] == structure[1], 2.0, 1.0)

    def values(self, of: FloatArray, by_x: FloatArray) -> FloatArray:
        """The entries, in the order of `lower`."""
        return self._times * self._second.values(by_x, self._first.values(of, by_x))


def _described(derivatives: str, functions: Sequence[Function]) -> str:
    """Where derivatives come from, with the functions named."""
    different = {id(function): function for function in functions}.values()
    words = [
        f"'{function.name}'{'' if function.has_hessian else ' (second derivatives by differences)'}"
        for function in different
    ]
    return f"{derivatives}, with {', '.join(words)} in Python"
