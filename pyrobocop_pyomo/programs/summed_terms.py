"""Rows that are sums of terms: linear parts as arrays, repeated nonlinear terms as functions of all their instances.

CasADi derives one small function for each shape of terms: a list of steps. The compiled evaluation
(``term_evaluation.c``) begins a step in some nanoseconds and goes over all instances in the processor's nearest memory.
Where it is not there, NumPy does the steps, each of which begins in half a microsecond.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.modeling.expression_nodes import comparisons
from pyrobocop_pyomo.optional_imports import casadi

from .compiled_terms import CompiledFunction, CompiledSums, CompiledTerm, NumpySums
from .model_terms import Terms
from .nonlinear_program import FloatArray, IndexArray
from .term_groups import TermArrays, decoded


class TermFunction:
    """The terms of one shape, evaluated all at once.

    Arrays of the values of one evaluation, and what belongs to each value, have shape (values, terms) and are flat.

    Parameters
    ----------
    terms : TermArrays

    Attributes
    ----------
    compiled : CompiledTerm
    parameters, places_of_parameters : int arrays
        Parameters that are read, and where each stands among the numbers of `compiled`.
    gradient_rows, gradient_columns : int arrays
        Rows and variables of the values of the gradient.
    hessian_rows, hessian_columns : int arrays
        Pairs of variables of the values of the Hessian; the first is not smaller.
    """

    def __init__(self, terms: TermArrays) -> None:
        columns, numbers, parameters = terms.columns, terms.numbers, terms.parameters
        instances, size = columns.shape
        # Numbers that are the same everywhere become part of the function; the others are arguments.
        varies = ((numbers != numbers[:1]) | (parameters >= 0)).any(axis=0)
        sizes = {"x": size, "p": int(np.count_nonzero(varies)), "w": 1}
        x, p, w = (casadi.SX.sym(name, size) for name, size in sizes.items())
        output = _output(terms, x, p, varies)
        gradient = casadi.jacobian(output, x)
        hessian = casadi.tril(casadi.hessian(w * output, x)[0])

        def flat(values: np.ndarray) -> np.ndarray:
            return np.ascontiguousarray(values.T).ravel()

        variable = np.array(gradient.sparsity().get_triplet()[1], dtype=np.intp)
        self.gradient_rows, self.gradient_columns = np.tile(terms.rows, variable.size), flat(columns[:, variable])
        triplet = hessian.sparsity().get_triplet()
        first, second = (flat(columns[:, np.array(indices, dtype=np.intp)]) for indices in triplet)
        self.hessian_rows, self.hessian_columns = np.maximum(first, second), np.minimum(first, second)

        known = flat(parameters[:, varies])
        self.places_of_parameters = np.flatnonzero(known >= 0)
        self.parameters = known[self.places_of_parameters]
        results = [
            casadi.cse(casadi.vertcat(*nonzeros))
            for nonzeros in (casadi.densify(output).nonzeros(), gradient.nonzeros(), hessian.nonzeros())
        ]
        functions = [CompiledFunction(casadi.Function("term", [x, p, w], [result])) for result in results]
        gradient_scales = np.tile(terms.scales, variable.size)
        self.compiled = CompiledTerm(
            functions, flat(columns), flat(numbers[:, varies]), terms.rows, terms.scales, gradient_scales, instances
        )

    def set_parameters(self, values: FloatArray) -> None:
        """Evaluate with these values of all parameters from now on."""
        self.compiled.numbers[self.places_of_parameters] = values[self.parameters]


def _output(terms: TermArrays, x: Any, p: Any, varies: np.ndarray) -> Any:
    free, given = iter(p.elements()), terms.numbers[0].tolist()
    numbers = [next(free) if changes else given[i] for i, changes in enumerate(varies.tolist())]
    # What a term has twice is found before it is differentiated: it is then differentiated once.
    return casadi.cse(casadi.SX(decoded(terms.code, x.elements(), numbers, _SYMBOLIC_FUNCTIONS)))


class _SymbolicFunctions(dict[str, Callable[..., Any]]):
    """Functions on CasADi's symbols by name, so that CasADi is imported by the first term and not before."""

    _OTHER_NAMES: ClassVar = {"abs": "fabs", "choose": "if_else"}

    def __init__(self) -> None:
        super().__init__(comparisons(lambda a, b: casadi.logic_and(a, b)))

    def __missing__(self, name: str) -> Callable[..., Any]:
        function: Callable[..., Any] = getattr(casadi, self._OTHER_NAMES.get(name, name))
        return function


_SYMBOLIC_FUNCTIONS = _SymbolicFunctions()


class SummedTerms:
    """Rows that are each a constant, a linear function and terms of some groups.

    Parameters
    ----------
    terms : Terms
    rows, n : int
        Counts of rows and variables.
    library : ctypes.CDLL or None
        The compiled evaluation; without it NumPy evaluates.

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
    hessian_structure : pair of int arrays
        Rows and columns of the Hessian's entries, once `place_hessians` has told.
    compiled : CompiledSums
        What evaluates them from then on.
    """

    hessian_structure: tuple[IndexArray, IndexArray]

    def __init__(self, terms: Terms, rows: int, n: int, library: ctypes.CDLL | None = None) -> None:
        try:
            self.functions = [TermFunction(group.arrays()) for group in terms.groups.values()]
        except ArithmeticError as error:  # among the numbers: those of variables are symbols here
            raise EvaluationError(f"a number in an expression does not exist: {error}") from None
        self.rows = rows
        self.constants = np.zeros(rows)
        for row, constant in terms.constants.items():
            self.constants[row] = constant
        (linear_rows, columns, coefficients), self.given = terms.linear_parts()
        kept = coefficients != 0.0
        self._linear = linear_rows[kept], columns[kept], coefficients[kept]
        nonlinear = [(function.gradient_rows, function.gradient_columns) for function in self.functions]
        pairs = [self._linear[:2], *nonlinear]
        self.structure, places = merged_places(pairs, n)
        count = self._linear[0].size
        entries = self.structure[0].size
        self._constant_jacobian: FloatArray = np.bincount(places[:count], self._linear[2], entries).astype(float)
        self._places = places[count:]
        self._offsets = self.constants.copy()
        self.hessian_pairs = [(function.hessian_rows, function.hessian_columns) for function in self.functions]
        self._library = library

    def place_hessian(self, places: np.ndarray) -> None:
        """Say where each entry of `hessian_pairs` is added, one function after the other."""
        gradient_places = _split(self._places, [function.gradient_rows.size for function in self.functions])
        hessian_places = _split(places, [rows.size for rows, _ in self.hessian_pairs])
        terms = [function.compiled for function in self.functions]
        self.compiled = (NumpySums if self._library is None else CompiledSums)(
            self._library, terms, gradient_places, hessian_places, self._offsets, self._linear, self._constant_jacobian
        )

    def set_parameters(self, values: FloatArray) -> None:
        """Evaluate with these values of all parameters from now on."""
        rows, parameters, coefficients = self.given
        with np.errstate(all="ignore"):  # what is not finite is noticed in the sums
            given = coefficients * values[parameters]
        self._offsets[:] = self.constants + np.bincount(rows, given, self.constants.size)
        for function in self.functions:
            function.set_parameters(values)


def place_hessians(several: Sequence[SummedTerms], n: int) -> tuple[IndexArray, IndexArray]:
    """Give the Hessians of several sums the same entries, and return their rows and columns; n variables."""
    structure, places = merged_places([pair for sums in several for pair in sums.hessian_pairs], n)
    sizes = [sum(rows.size for rows, _ in sums.hessian_pairs) for sums in several]
    for sums, own in zip(several, _split(places, sizes), strict=True):
        sums.hessian_structure = structure
        sums.place_hessian(own)
    return structure


def _split(places: np.ndarray, sizes: Sequence[int]) -> list[np.ndarray]:
    return np.split(places, np.cumsum(sizes)[:-1]) if sizes else []


def merged_places(
    pairs: Sequence[tuple[np.ndarray, np.ndarray]], n: int
) -> tuple[tuple[IndexArray, IndexArray], np.ndarray]:
    """Each pair of a row and a column once, and the place among them of every pair given; n columns."""
    rows = np.concatenate([np.empty(0, dtype=np.intp), *(row for row, _ in pairs)])
    columns = np.concatenate([np.empty(0, dtype=np.intp), *(column for _, column in pairs)])
    keys, places = np.unique(rows * n + columns, return_inverse=True)
    return ((keys // n).astype(np.int32), (keys % n).astype(np.int32)), places.ravel()
