"""Rows that are sums of terms: linear parts as arrays, repeated nonlinear terms as functions of all their instances."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

import numpy as np

from .compiled_terms import CompiledSums
from .model_terms import Terms
from .nonlinear_program import FloatArray, IndexArray
from .term_functions import TermFunction, term_functions


class SummedTerms:
    """Rows that are each a constant, a linear function and terms of some groups.

    Parameters
    ----------
    terms : Terms
    rows, n : int
        Counts of rows and variables.
    library : ctypes.CDLL or None
        The compiled evaluation, where it takes the terms.

    Attributes
    ----------
    rows : int
    functions : list of TermFunction
    constants : float array
        Of the rows.
    given : tuple of arrays
        Rows, parameters and coefficients of the parameters that are added to rows.
    structure : pair of int arrays
        Rows and columns of the Jacobian's entries.
    hessian_pairs : list of pairs of int arrays
        Variables of the entries that each function adds to a Hessian.
    """

    def __init__(self, terms: Terms, rows: int, n: int, library: ctypes.CDLL | None = None) -> None:
        self.functions: list[TermFunction] = term_functions(terms.groups.values(), compiled=library is not None)
        self.rows = rows
        self.constants = np.zeros(rows)
        for row, constant in terms.constants.items():
            self.constants[row] = constant
        (linear_rows, columns, coefficients), self.given = terms.linear_parts()
        kept = coefficients != 0.0
        self._linear = linear_rows[kept], columns[kept], coefficients[kept]
        self._value_rows = np.concatenate([self._linear[0], *(function.rows for function in self.functions)])
        nonlinear = [(function.gradient_rows, function.gradient_columns) for function in self.functions]
        pairs = [self._linear[:2], *nonlinear]
        self.structure, places = merged_places(pairs, n)
        count = self._linear[0].size
        self._size = self.structure[0].size
        self._constant_jacobian: FloatArray = np.bincount(places[:count], self._linear[2], self._size).astype(float)
        self._places = places[count:]
        self._offsets = self.constants.copy()
        self.hessian_pairs = [(function.hessian_rows, function.hessian_columns) for function in self.functions]
        self._library = library
        self._compiled: CompiledSums | None = None

    def place_hessian(self, places: np.ndarray) -> None:
        """Say where each entry of `hessian_pairs` is added, one function after the other."""
        self._hessian_places = places
        if self._library is not None:
            gradient_places = _split(self._places, [function.gradient_rows.size for function in self.functions])
            hessian_places = _split(places, [rows.size for rows, _ in self.hessian_pairs])
            terms = [function.compiled for function in self.functions if function.compiled is not None]
            self._compiled = CompiledSums(
                self._library, terms, gradient_places, hessian_places, self._offsets, self._linear,
                self._constant_jacobian,
            )  # fmt: skip

    @property
    def compiled(self) -> CompiledSums:
        """For the compiled evaluation."""
        assert self._compiled is not None
        return self._compiled

    def set_parameters(self, values: FloatArray) -> None:
        """Evaluate with these values of all parameters from now on."""
        rows, parameters, coefficients = self.given
        with np.errstate(all="ignore"):  # what is not finite is noticed in the sums
            given = coefficients * values[parameters]
        self._offsets[:] = self.constants + np.bincount(rows, given, self.constants.size)
        for function in self.functions:
            function.set_parameters(values)

    def values(self, x: FloatArray) -> FloatArray:
        """Values of the rows."""
        if self._compiled is not None:
            return self._compiled.values(x)
        _, columns, coefficients = self._linear
        with np.errstate(all="ignore"):
            summands = [coefficients * x.take(columns), *(part.scales * part.value(x) for part in self.functions)]
            return self._offsets + summed(self._value_rows, summands, self._offsets.size)

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Entries of the Jacobian, in the order of `structure`."""
        if self._compiled is not None:
            return self._compiled.jacobian(x)
        with np.errstate(all="ignore"):
            blocks = [function.gradient_scales * function.gradient(x) for function in self.functions]
            return self._constant_jacobian + summed(self._places, blocks, self._size)

    def add_hessian(self, x: FloatArray, weights: FloatArray, entries: FloatArray) -> None:
        """Add the Hessian of weights @ rows to the entries that `place_hessian` has told."""
        if self._compiled is not None:
            self._compiled.add_hessian(x, weights, entries)
        elif self.functions:
            blocks = [function.hessian(x, weights) for function in self.functions]
            entries += summed(self._hessian_places, blocks, entries.size)


def place_hessians(several: Sequence[SummedTerms], n: int) -> tuple[IndexArray, IndexArray]:
    """Give the Hessians of several sums the same entries, and return their rows and columns; n variables."""
    structure, places = merged_places([pair for sums in several for pair in sums.hessian_pairs], n)
    sizes = [sum(rows.size for rows, _ in sums.hessian_pairs) for sums in several]
    for sums, own in zip(several, _split(places, sizes), strict=True):
        sums.place_hessian(own)
    return structure


def _split(places: np.ndarray, sizes: Sequence[int]) -> list[np.ndarray]:
    return np.split(places, np.cumsum(sizes)[:-1]) if sizes else []


def summed(places: np.ndarray, blocks: Sequence[FloatArray], size: int) -> FloatArray:
    """The entries of all blocks, one after the other, added up in their places."""
    if not blocks:
        return np.zeros(size)
    # bincount adds repeated places up in one pass, several times faster than add.at.
    weights = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
    return np.bincount(places, weights, size).astype(float, copy=False)


def merged_places(
    pairs: Sequence[tuple[np.ndarray, np.ndarray]], n: int
) -> tuple[tuple[IndexArray, IndexArray], np.ndarray]:
    """Each pair of a row and a column once, and the place among them of every pair given; n columns."""
    rows = np.concatenate([np.empty(0, dtype=np.intp), *(row for row, _ in pairs)])
    columns = np.concatenate([np.empty(0, dtype=np.intp), *(column for _, column in pairs)])
    keys, places = np.unique(rows * n + columns, return_inverse=True)
    return ((keys // n).astype(np.int32), (keys % n).astype(np.int32)), places.ravel()
