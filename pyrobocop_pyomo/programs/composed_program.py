"""A nonlinear program with Python functions in it: compiled expressions around functions that take many points at once.

The program is ``f(x, y)`` and ``g(x, y)``, where ``y = F(u(x, y))`` stands for the outputs of all calls. The variables
of the composition are x alone: y is eliminated level by level, since a call holds in its arguments only calls of lower
levels. With ``Y = dy/dx`` and ``U = du/dx`` along the elimination and the adjoints
``nu = f_y + g_y' lambda + u_y' mu`` and ``mu = F_u' nu``, the Hessian of the Lagrangian is::

    [I; Y]' (Hessian of f + lambda' g + mu' u by (x, y)) [I; Y]  +  sum over the calls  U' (nu' F_uu) U

Each evaluation calls each function once, for all points of a level together.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.modeling.functions import Function

from .nonlinear_program import FloatArray
from .sparse_entries import merged_places, ranges, summed
from .vectorised_program import ArgumentRows, VectorisedProgram

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Points:
    """All calls of one function on one level.

    Attributes
    ----------
    function : Function
    rows : int array, shape (points, inputs)
        Rows of the level that are the arguments; each row is one argument.
    outputs : int array, shape (points, outputs)
        Places among all y, -1 for an output that nothing uses.
    """

    function: Function
    rows: np.ndarray
    outputs: np.ndarray


@dataclass(frozen=True, eq=False)
class Level:
    """The arguments of calls that hold no other calls than those of lower levels.

    Attributes
    ----------
    arguments : ArgumentRows
    points : list of Points
    """

    arguments: ArgumentRows
    points: list[Points]


class _Dependence:
    """``[I; Y]`` as rows of entries: what x and y depend on, in one array of values that changes with the point."""

    def __init__(self, n: int, outputs: int) -> None:
        self.starts = np.concatenate([np.arange(n), np.zeros(outputs, dtype=np.intp)])
        self.counts = np.concatenate([np.ones(n, dtype=np.intp), np.zeros(outputs, dtype=np.intp)])
        self.columns = np.arange(n)

    def append(self, places: np.ndarray, counts: np.ndarray, columns: np.ndarray) -> None:
        """Further entries of y: their places, how many values each has, and by which x they are."""
        self.starts[places] = self.columns.size + np.cumsum(counts) - counts
        self.counts[places] = counts
        self.columns = np.concatenate([self.columns, columns])

    def expanded(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """For a derivative by each of some x and y: which of them, and the place of the value it is multiplied by."""
        counts = self.counts[places]
        return np.repeat(np.arange(places.size), counts), ranges(self.starts[places], counts)


class _Product:
    """A Jacobian by (x, y) times ``[I; Y]``: one sum of products for each entry."""

    def __init__(self, dependence: _Dependence, rows: np.ndarray, places: np.ndarray) -> None:
        self._entries, self._values = dependence.expanded(places)
        self.rows, self.columns = rows[self._entries], dependence.columns[self._values]

    def values(self, jacobian: FloatArray, dependence: FloatArray) -> FloatArray:
        """Summands, in the order of `rows` and `columns`."""
        return jacobian[self._entries] * dependence[self._values]


class _Congruence:
    """A Hessian by (x, y) between ``[I; Y]`` and its transpose, as entries of the lower triangle."""

    def __init__(self, dependence: _Dependence, first: np.ndarray, second: np.ndarray) -> None:
        firsts, seconds = dependence.counts[first], dependence.counts[second]
        products = firsts * seconds
        self._entries = np.repeat(np.arange(first.size), products)
        position = ranges(np.zeros(first.size, dtype=np.intp), products)
        self._first = dependence.starts[first][self._entries] + position // np.maximum(seconds, 1)[self._entries]
        self._second = dependence.starts[second][self._entries] + position % np.maximum(seconds, 1)[self._entries]
        one, other = dependence.columns[self._first], dependence.columns[self._second]
        self.rows, self.columns = np.maximum(one, other), np.minimum(one, other)
        # An entry beside the diagonal stands for two; one on it meets both orders of two different columns.
        diagonal = (first == second)[self._entries]
        same = one == other
        self._factors = np.where(diagonal, np.where(same, 1.0, 0.5), np.where(same, 2.0, 1.0))

    def values(self, hessian: FloatArray, dependence: FloatArray) -> FloatArray:
        """Summands, in the order of `rows` and `columns`."""
        return self._factors * hessian[self._entries] * dependence[self._first] * dependence[self._second]


class _PointDerivatives:
    """Derivatives of all calls of one function on a level, as dense blocks by the x that each call depends on."""

    def __init__(self, level: Level, points: Points, product: _Product, dependence: _Dependence, n: int) -> None:
        self.points = points
        count, inputs = points.rows.shape
        argument_of = np.full(level.arguments.m, -1, dtype=np.intp)
        argument_of[points.rows.ravel()] = np.arange(points.rows.size)
        self._entries = np.flatnonzero(argument_of[product.rows] >= 0)
        argument, columns = argument_of[product.rows[self._entries]], product.columns[self._entries]
        keys, place = np.unique((argument // inputs) * n + columns, return_inverse=True)
        sizes = np.bincount(keys // n, minlength=count)
        width = int(sizes.max(initial=0))
        position = np.arange(keys.size) - (np.cumsum(sizes) - sizes)[keys // n]
        self._targets = argument * width + position[place.ravel()]
        self._shape = (count, inputs, width)
        by = np.full((count, width), -1, dtype=np.intp)
        by[keys // n, position] = keys % n
        filled = by >= 0
        # Rows of the dependence for the outputs that are used, in the order of their places.
        self.used = points.outputs >= 0
        call = np.broadcast_to(np.arange(count)[:, None], self.used.shape)[self.used]
        self._first_value = dependence.columns.size
        dependence.append(n + points.outputs[self.used], sizes[call], by[call][filled[call]])
        self._kept = np.flatnonzero(np.broadcast_to(filled[:, None, :], (*self.used.shape, width))[self.used].ravel())
        one, other = np.tril_indices(width)
        self._lower = np.flatnonzero((filled[:, one] & filled[:, other]).ravel())
        self._triangle = one, other
        self.rows = by[:, one].ravel()[self._lower]
        self.columns = by[:, other].ravel()[self._lower]

    def differentiate(self, inputs: FloatArray, summands: FloatArray, dependence: FloatArray) -> None:
        """Take the first derivatives, and put those of the outputs into the dependence."""
        self._inputs = inputs
        size = int(np.prod(self._shape))
        self.u = summed(self._targets, [summands[self._entries]], size).reshape(self._shape)
        self.jacobian = self.points.function.jacobians(inputs)
        values = (self.jacobian @ self.u)[self.used].ravel()[self._kept]
        dependence[self._first_value : self._first_value + values.size] = values

    def second(self, adjoint: FloatArray) -> FloatArray:
        """Entries of ``U' (nu' F_uu) U``; the adjoint has shape (points, outputs)."""
        if not adjoint.any():
            return np.zeros(self._lower.size)
        by_inputs = np.einsum("po,poij->pij", adjoint, self.points.function.hessians(self._inputs))
        block = self.u.swapaxes(1, 2) @ by_inputs @ self.u
        one, other = self._triangle
        return block[:, one, other].ravel()[self._lower]


class _LevelDerivatives:
    """A level with what its derivatives are put together from."""

    def __init__(self, level: Level, columns: np.ndarray, dependence: _Dependence, n: int) -> None:
        self.level = level
        rows, by = level.arguments.jacobian_structure
        by = columns[by]
        self.jacobian = np.zeros(rows.size)
        self.product = _Product(dependence, rows, by)
        self.congruence = _Congruence(dependence, *(columns[index] for index in level.arguments.hessian_structure))
        # Derivatives by y, for the adjoints of lower levels.
        self.by_y = np.flatnonzero(by >= n)
        self.y_of, self.row_of = by[self.by_y] - n, rows[self.by_y]
        self.points = [_PointDerivatives(level, points, self.product, dependence, n) for points in level.points]

    def inputs(self, x: FloatArray) -> list[FloatArray]:
        """Arguments of the calls, one array for each function."""
        rows = self.level.arguments.constraints(x)
        return [rows[points.rows] for points in self.level.points]


class ComposedProgram:
    """See the module; a `NonlinearProgram` in x.

    Parameters
    ----------
    main : VectorisedProgram
        The objective and the rows, with variables that stand for the outputs of calls.
    columns : int array
        The places of its variables in the vector of x and y.
    n : int
        Count of x.
    levels : sequence of Level
        From the lowest on.
    outputs : int
        Count of y.
    """

    def __init__(
        self,
        main: VectorisedProgram,
        columns: np.ndarray,
        n: int,
        levels: Sequence[Level],
        outputs: int,
    ) -> None:
        self._main, self._columns, self.n, self._y = main, columns, n, outputs
        self.m = main.m
        self.g_multipliers_start: FloatArray | None = None
        dependence = _Dependence(n, outputs)
        self._levels = [_LevelDerivatives(level, columns, dependence, n) for level in levels]
        self._dependence = np.ones(dependence.columns.size)
        rows, by = main.jacobian_structure
        by = columns[by]
        self._product = _Product(dependence, rows, by)
        self.jacobian_structure, self._jacobian_places = merged_places([(self._product.rows, self._product.columns)], n)
        self._by_y = np.flatnonzero(by >= n)
        self._y_of, self._row_of = by[self._by_y] - n, rows[self._by_y]
        self._gradient = _Product(dependence, np.zeros(columns.size, dtype=np.intp), columns)
        self._congruence = _Congruence(dependence, *(columns[index] for index in main.hessian_structure))
        parts: list[Any] = [self._congruence]
        for level in self._levels:
            parts += [level.congruence, *level.points]
        self.hessian_structure, self._hessian_places = merged_places([(part.rows, part.columns) for part in parts], n)
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
        for level in self._levels:
            for points, inputs in zip(level.level.points, level.inputs(self._z[self._columns]), strict=True):
                points.function.check_derivatives_once(inputs)

    # ---------------------------------------------------------------- evaluation

    def _at(self, x: FloatArray) -> FloatArray:
        """The variables of the main program."""
        if self._z_at is None or not np.array_equal(self._z_at, x):
            self._z_at = None
            z = np.zeros(self.n + self._y)
            z[: self.n] = x
            self._inputs = []
            for level in self._levels:
                inputs = level.inputs(z[self._columns])
                self._inputs.append(inputs)
                for points, X in zip(level.level.points, inputs, strict=True):
                    used = points.outputs >= 0
                    z[self.n + points.outputs[used]] = points.function.values(X)[used]
            self._z, self._z_at = z, np.array(x)
        return self._z[self._columns]

    def _differentiate(self, x: FloatArray) -> FloatArray:
        """The same, with the first derivatives of y known."""
        z = self._at(x)
        if self._differentiated_at is None or not np.array_equal(self._differentiated_at, x):
            self._differentiated_at = None
            for level, inputs in zip(self._levels, self._inputs, strict=True):
                level.jacobian = level.level.arguments.jacobian(z)
                summands = level.product.values(level.jacobian, self._dependence)
                for points, X in zip(level.points, inputs, strict=True):
                    points.differentiate(X, summands, self._dependence)
            self._differentiated_at = np.array(x)
        return z

    def objective(self, x: FloatArray) -> float:
        """Value of f."""
        return self._main.objective(self._at(x))

    def gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of f."""
        gradient = self._main.gradient(self._differentiate(x))
        return summed(self._gradient.columns, [self._gradient.values(gradient, self._dependence)], self.n)

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of g."""
        return self._main.constraints(self._at(x))

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Values of the Jacobian of g."""
        jacobian = self._main.jacobian(self._differentiate(x))
        summands = self._product.values(jacobian, self._dependence)
        return summed(self._jacobian_places, [summands], self.jacobian_structure[0].size)

    def hessian(self, x: FloatArray, objective_factor: float, multipliers: FloatArray) -> FloatArray:
        """Values of the Hessian of the Lagrangian."""
        z = self._differentiate(x)
        slopes = np.zeros(self.n + self._y)
        slopes[self._columns] = objective_factor * self._main.gradient(z)
        adjoint = slopes[self.n :]
        by_y = multipliers[self._row_of] * self._main.jacobian(z)[self._by_y]
        adjoint += summed(self._y_of, [by_y], self._y)
        blocks = [self._congruence.values(self._main.hessian(z, objective_factor, multipliers), self._dependence)]
        upper: list[list[FloatArray]] = []
        for level in reversed(self._levels):
            arguments = level.level.arguments
            of_rows = np.zeros(arguments.m)
            of_points = []
            for points in level.points:
                of_outputs = np.zeros(points.used.shape)
                of_outputs[points.used] = adjoint[points.points.outputs[points.used]]
                of_rows[points.points.rows] = np.einsum("po,poi->pi", of_outputs, points.jacobian)
                of_points.append(points.second(of_outputs))
            adjoint += summed(level.y_of, [of_rows[level.row_of] * level.jacobian[level.by_y]], self._y)
            of_points.insert(0, level.congruence.values(arguments.hessian(z, 0.0, of_rows), self._dependence))
            upper.insert(0, of_points)
        for of_points in upper:
            blocks += of_points
        return summed(self._hessian_places, blocks, self.hessian_structure[0].size)


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
