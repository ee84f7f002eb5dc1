"""A nonlinear program in fewer variables: the others follow from them, and some rows are left out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyrobocop_pyomo.optional_imports import scipy

from .nonlinear_program import FloatArray, IndexArray, NonlinearProgram, WrappedProgram

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Numbers = NDArray[np.integer[Any]]


class AggregatedProgram(WrappedProgram):
    """A nonlinear program with ``x = P z + offset`` and without some of its rows.

    Every variable z is one of the x as well: the one in whose row P has a single 1. It keeps that variable's bounds.

    Parameters
    ----------
    nlp : NonlinearProgram
    interpolation : sparse matrix, shape (n, number of z)
        ``P``.
    offset : float array, shape (n,)
    kept : int array, shape (number of z,)
        Which x each z is.
    rows : int array
        Numbers of the rows that are kept.

    Attributes
    ----------
    kept, rows : int array
        As given.
    """

    def __init__(
        self,
        nlp: NonlinearProgram,
        interpolation: csr_array,
        offset: FloatArray,
        kept: ArrayLike,
        rows: ArrayLike,
    ) -> None:
        super().__init__(nlp)
        self._interpolation, self._offset = scipy.sparse.csr_array(interpolation), offset
        self.kept, self.rows = np.asarray(kept, dtype=np.intp), np.asarray(rows, dtype=np.intp)
        self.n, self.m = self.kept.size, self.rows.size
        self.x_lower, self.x_upper = nlp.x_lower[self.kept], nlp.x_upper[self.kept]
        self.g_lower, self.g_upper = nlp.g_lower[self.rows], nlp.g_upper[self.rows]
        self.x_start = nlp.x_start[self.kept]
        self.g_multipliers_start = None if nlp.g_multipliers_start is None else nlp.g_multipliers_start[self.rows]
        self.objective, self.gradient = self._objective, self._gradient
        self._number_of = np.full(nlp.m, -1, dtype=np.intp)
        self._number_of[self.rows] = np.arange(self.m)
        self._prepare_jacobian()
        self._prepare_hessian()

    def at(self, z: FloatArray) -> FloatArray:
        """All variables, shape (n,) of the program that this one is made from."""
        return self._interpolation @ z + self._offset

    def restrict(self, x: FloatArray) -> FloatArray:
        """The variables of this program out of all."""
        return x[self.kept]

    def numbers_of_rows(self, rows: Numbers) -> Numbers:
        """Of rows of the whole program those that are kept, by their numbers here."""
        return self._number_of[rows][self._number_of[rows] >= 0]

    def _objective(self, x: FloatArray) -> float:
        return self.nlp.objective(self.at(x))

    def _gradient(self, x: FloatArray) -> FloatArray:
        return self._interpolation.T @ self.nlp.gradient(self.at(x))

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of the rows that are kept, shape (m,)."""
        return self.nlp.constraints(self.at(x))[self.rows]

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Values of their Jacobian in the order of `jacobian_structure`."""
        return self._to_jacobian @ self.nlp.jacobian(self.at(x))

    def hessian(self, x: FloatArray, objective_factor: float, multipliers: FloatArray) -> FloatArray:
        """Values of the Hessian of objective_factor * f + multipliers @ g."""
        every = np.zeros(self.nlp.m)
        every[self.rows] = multipliers
        return self._to_hessian @ self.nlp.hessian(self.at(x), objective_factor, every)

    def _prepare_jacobian(self) -> None:
        rows, columns = self.nlp.jacobian_structure
        entries = np.flatnonzero(self._number_of[rows] >= 0)
        spread, others, weights = self._spread(columns[entries])
        new_rows = self._number_of[rows[entries]][spread]
        self.jacobian_structure, self._to_jacobian = _summed(
            new_rows, others, weights, entries[spread], self.n, rows.size
        )

    def _prepare_hessian(self) -> None:
        rows, columns = self.nlp.hessian_structure
        # An entry stands for two of the symmetric matrix, unless it is on the diagonal; both are spread, and of what
        # comes out the lower triangle is kept.
        off = np.flatnonzero(rows != columns)
        entries = np.concatenate([np.arange(rows.size), off])
        first, second = np.concatenate([rows, columns[off]]), np.concatenate([columns, rows[off]])
        spread, new_rows, weights = self._spread(first)
        again, new_columns, more = self._spread(second[spread])
        entries, new_rows, weights = entries[spread][again], new_rows[again], weights[again] * more
        lower = new_rows >= new_columns
        self.hessian_structure, self._to_hessian = _summed(
            new_rows[lower], new_columns[lower], weights[lower], entries[lower], self.n, rows.size
        )

    def _spread(self, columns: ArrayLike) -> tuple[Numbers, Numbers, FloatArray]:
        """For variables x: the numbers of their terms in z among them, which z, and with what weight."""
        starts, columns = self._interpolation.indptr, np.asarray(columns)
        counts = np.diff(starts)[columns]
        spread = np.repeat(np.arange(columns.size), counts)
        within = np.arange(spread.size) - np.repeat(np.cumsum(counts) - counts, counts)
        terms = starts[columns][spread] + within
        return spread, self._interpolation.indices[terms], self._interpolation.data[terms]


def _summed(
    rows: Numbers, columns: Numbers, weights: FloatArray, entries: Numbers, width: int, size: int
) -> tuple[tuple[IndexArray, IndexArray], csr_array]:
    """The structure without duplicates, and the matrix that takes the values of `size` entries to it."""
    places, number = np.unique(rows.astype(np.int64) * width + columns, return_inverse=True)
    matrix = scipy.sparse.csr_array((weights, (number, entries)), shape=(places.size, size))
    return ((places // width).astype(np.int32), (places % width).astype(np.int32)), matrix
