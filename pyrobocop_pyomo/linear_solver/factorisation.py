"""The linear solver from Python: factors of sparse symmetric matrices, with their inertia.

The compiled linear solver, and where it is looked for.
"""

from __future__ import annotations

import ctypes
import enum
import functools
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError, SolverNotFoundError
from pyrobocop_pyomo.native.shared_library import HOW_TO_COMPILE, SWITCH_VARIABLE, shared_library

# ---------------------------------------------------------------------------------------------------------- the library


LINEAR_SOLVER_VARIABLE = "PYROBOCOP_LINEAR_SOLVER"
LINEAR_SOLVER_NAME = "linear_solver"


def find_linear_solver() -> str | None:
    """Path of the compiled linear solver, or None where there is none.

    The environment variable ``PYROBOCOP_LINEAR_SOLVER`` may name a library that speaks MA27's convention, or be
    ``none``. Otherwise it is the one that was compiled when the package was installed; with ``PYROBOCOP_NATIVE=off``,
    or where there was no C compiler, there is none.

    Raises
    ------
    SolverNotFoundError
        When the variable names a file that does not exist.
    """
    chosen = os.environ.get(LINEAR_SOLVER_VARIABLE)
    if chosen:
        if chosen.lower() == "none":
            return None
        if not Path(chosen).is_file():
            raise SolverNotFoundError(
                f"{LINEAR_SOLVER_VARIABLE} is '{chosen}', but there is no such file. Correct the variable, unset it, "
                "or set it to 'none'."
            )
        return str(Path(chosen).resolve())
    return _compiled(os.environ.get(SWITCH_VARIABLE, ""))


def required_linear_solver() -> str:
    """As `find_linear_solver`, but refused where there is none."""
    path = find_linear_solver()
    if path is None:
        raise SolverNotFoundError(
            f"there is no compiled linear solver: {HOW_TO_COMPILE}; "
            "PYROBOCOP_NATIVE and PYROBOCOP_LINEAR_SOLVER must not say 'off' or 'none'. Ipopt's own is MUMPS."
        )
    return path


@functools.cache
def _compiled(_switch: str) -> str | None:
    """Asked once for each setting of the environment: hashing sources takes as long as a small solve."""
    found = shared_library(LINEAR_SOLVER_NAME)
    return None if found is None else str(found)


# -------------------------------------------------------------------------------------------------------- factorisation


FloatArray = np.ndarray[Any, np.dtype[np.float64]]
IntArray = np.ndarray[Any, np.dtype[np.int32]]

# How a factorisation ended, in MA27's convention.
_Flag = enum.IntEnum("_Flag", {"SHORT_INTEGERS": -3, "SHORT_REALS": -4, "SINGULAR": -5})
# Where the caller says whether negative eigenvalues are to be told even of a singular matrix, as Ipopt likes it.
_COUNT_FIRST = 29
_LARGEST = np.iinfo(np.int32).max
# As Ipopt does it: proposed lengths are multiplied by five, lengths that were too short at least by two.
_SPARE, _GROWTH = 5, 2


@dataclass(frozen=True)
class Factorised:
    """What a factorisation found out.

    Attributes
    ----------
    negative : int
        Eigenvalues below zero.
    blocks : int
        Pivots with two rows.
    entries : int
        Entries of the factor.
    largest_front : int
        Rows of the largest dense matrix that was factored.
    """

    negative: int
    blocks: int
    entries: int
    largest_front: int


@dataclass(frozen=True)
class FactorSize:
    """What a factorisation will cost, as far as no pivot is delayed.

    Attributes
    ----------
    entries : float
        Entries of the factor, with the zeros that are stored.
    operations : float
        Multiplications.
    largest_front : int
        Rows of the largest dense matrix.
    """

    entries: float
    operations: float
    largest_front: int


@functools.cache
def _load(path: str) -> ctypes.CDLL:
    return ctypes.CDLL(path)


def _address(array: np.ndarray[Any, Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


class SymmetricFactorisation:
    """Factors P A P' = L D L' of matrices with one structure, by the solver that Ipopt can load.

    The order of elimination is found by the first `factor` and kept. What a factorisation needs lies in this object,
    so several live side by side, each in the thread that calls it.

    Parameters
    ----------
    n : int
        Rows of the matrix.
    rows, columns : array_like of int, shape (entries,)
        Where its entries are, counted from 0: each in either triangle; entries at one place are added.
    library : str, optional
        The compiled solver, by default what `find_linear_solver` finds.

    Raises
    ------
    SolverNotFoundError
        When there is no compiled solver.
    ValueError
        For a matrix without rows, and for indices outside of it.
    """

    def __init__(self, n: int, rows: Any, columns: Any, library: str | None = None) -> None:
        self._functions = _load(library or required_linear_solver())
        self._rows, self._columns = _indices(n, rows, "rows"), _indices(n, columns, "columns")
        if self._rows.size != self._columns.size:
            raise ValueError(f"{self._rows.size} rows are given for {self._columns.size} columns.")
        self.n, self.entries = n, self._rows.size
        self._size, self._count = np.array([n], np.int32), np.array([self.entries], np.int32)
        self._keep, self._spare = np.zeros(3 * n, np.int32), np.zeros(2 * n, np.int32)
        self._options, self._tolerances = np.zeros(30, np.int32), np.zeros(5)
        self._info, self._front = np.zeros(20, np.int32), np.zeros(1, np.int32)
        self._steps, self._integers, self._reals = np.zeros(1, np.int32), np.zeros(1, np.int32), np.zeros(0)
        self._functions.ma27id_(_address(self._options), _address(self._tolerances))
        self._options[_COUNT_FIRST] = 0
        zero, work = np.zeros(1, np.int32), np.zeros(1)
        self._call(
            "ma27ad_", self._size, self._count, self._rows, self._columns, self._integers, self._length(self._integers),
            self._keep, self._spare, self._steps, zero, self._options, self._tolerances, self._info, work,
        )  # fmt: skip
        self._allocate(_SPARE * int(self._info[5]), max(self.entries, _SPARE * int(self._info[4])))

    def _allocate(self, integers: int, reals: int) -> None:
        self._integers = np.empty(min(integers, _LARGEST), np.int32)
        self._reals = np.empty(min(reals, _LARGEST))
        self._factored = False

    @staticmethod
    def _length(array: np.ndarray[Any, Any]) -> IntArray:
        return np.array([array.size], np.int32)

    def _call(self, name: str, *arrays: np.ndarray[Any, Any]) -> None:
        getattr(self._functions, name)(*map(_address, arrays))

    def factor(self, values: Any, threshold: float = 1e-8) -> Factorised:
        """Factor the matrix with these entries.

        Parameters
        ----------
        values : array_like, shape (entries,)
            The entries, in the order of `rows` and `columns`.
        threshold : float
            Smallest part of its column that a pivot may be; better ones (a tenth) are taken first.

        Returns
        -------
        Factorised
            Inertia and size.

        Raises
        ------
        EvaluationError
            When a pivot is missing, or an entry is not finite.
        MemoryError
            When the factor has more entries than a 32-bit integer counts, or there is no memory.
        """
        entries = np.asarray(values, dtype=np.float64)
        if entries.shape != (self.entries,):
            raise ValueError(f"'values' has shape {entries.shape}; this matrix needs ({self.entries},).")
        self._tolerances[0] = threshold
        while True:
            self._factored = False
            self._reals[: self.entries] = entries
            self._call(
                "ma27bd_", self._size, self._count, self._rows, self._columns, self._reals, self._length(self._reals),
                self._integers, self._length(self._integers), self._keep, self._steps, self._front, self._spare,
                self._options, self._tolerances, self._info,
            )  # fmt: skip
            flag, detail = int(self._info[0]), int(self._info[1])
            if flag == _Flag.SINGULAR:
                raise EvaluationError(
                    f"the matrix with {self.n} rows is singular to working precision, or an entry is not finite."
                )
            if flag not in (_Flag.SHORT_INTEGERS, _Flag.SHORT_REALS):
                break
            grown = [_GROWTH * self._integers.size, _GROWTH * self._reals.size]
            short = 0 if flag == _Flag.SHORT_INTEGERS else 1
            grown[short] = max(grown[short], detail)
            self._allocate(*grown)
        if flag != 0:
            raise MemoryError(f"the matrix with {self.n} rows could not be factored (flag {flag}, {detail}).")
        self._factored = True
        info = self._info
        return Factorised(int(info[14]), int(info[13]), int(info[4]), int(self._front[0]))

    def solve(self, right_side: Any) -> FloatArray:
        """Solution of A x = b, without refinement.

        Parameters
        ----------
        right_side : array_like, shape (n,)
            b.

        Raises
        ------
        RuntimeError
            When the last `factor` did not succeed, or there was none.
        """
        if not self._factored:
            raise RuntimeError("there is no factor to solve with: call factor(values) first.")
        x = np.array(right_side, dtype=np.float64)
        if x.shape != (self.n,):
            raise ValueError(f"'right_side' has shape {x.shape}; this matrix needs ({self.n},).")
        self._call(
            "ma27cd_", self._size, self._reals, self._length(self._reals), self._integers, self._length(self._integers),
            np.empty(max(int(self._front[0]), 1)), self._front, x, self._spare, self._steps, self._options,
            self._tolerances,
        )  # fmt: skip
        return x

    def size_of_factor(self, values: Any) -> FactorSize | None:
        """What factoring a matrix with such entries costs, from its structure and its weak diagonal entries.

        None where the structure of the factor needs more memory than can be had.
        """
        sizes, entries = np.zeros(3), np.ascontiguousarray(values, dtype=np.float64)
        if entries.shape != (self.entries,):
            raise ValueError(f"'values' has shape {entries.shape}; this matrix needs ({self.entries},).")
        failed = self._functions.pyrobocop_factor_size(
            self.n, self.entries, _address(self._rows), _address(self._columns), _address(entries), _address(sizes)
        )
        return None if failed else FactorSize(float(sizes[0]), float(sizes[1]), int(sizes[2]))


def _indices(n: int, values: Any, name: str) -> IntArray:
    """Counted from 1, as the convention has it."""
    if not 1 <= n < _LARGEST // 3:
        raise ValueError(f"a matrix with {n} rows cannot be factored.")
    indices = np.asarray(values)
    if indices.ndim != 1 or (indices.size and (indices.min() < 0 or indices.max() >= n)):
        raise ValueError(f"'{name}' must be a list of indices from 0 to {n - 1}.")
    return np.ascontiguousarray(indices + 1, dtype=np.int32)
