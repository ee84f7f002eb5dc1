"""Rows that are sums of terms: linear parts as arrays, repeated nonlinear terms as functions of all their instances.

CasADi derives one small function for each shape of terms: a list of steps. The compiled evaluation
(``term_evaluation.c``) begins a step in some nanoseconds and goes over all instances in the processor's nearest memory.
Where it is not there, CasADi evaluates the functions.

Summed terms for the compiled evaluation in ``term_evaluation.c``.

That library knows nothing of a particular model: it is compiled once, and gets each model's functions as arrays. What
the structures here point to belongs to the objects that made it, and is kept alive by them.
"""

from __future__ import annotations

import ctypes
import functools
import logging
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.modeling.expression_nodes import NUMPY_NAMES, comparisons
from pyrobocop_pyomo.native.shared_library import HOW_TO_COMPILE, library_file, native_allowed, shared_library
from pyrobocop_pyomo.optional_imports import casadi, scipy

from .model_terms import Terms
from .nonlinear_program import FloatArray, IndexArray
from .term_groups import Code, TermArrays, decoded

# -------------------------------------------------------------------------------------------------- compiled evaluation


logger = logging.getLogger(__name__)

TERM_EVALUATION = "term_evaluation"
SOURCE = Path(__file__).with_name("term_evaluation.c")


# Each number in the source is a place here: what is not arithmetic, and then CasADi's operations.
OPERATIONS = (
    "READ_VARIABLE", "READ_NUMBER", "READ_WEIGHT", "CONSTANT", "ADD_OUTPUT", "ADD", "SUB", "MUL", "DIV", "NEG", "INV",
    "SQ", "TWICE", "SQRT", "POW", "EXP", "LOG", "LOG1P", "EXPM1", "SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN", "ATAN2",
    "SINH", "COSH", "TANH", "ASINH", "ACOSH", "ATANH", "FABS", "SIGN", "COPYSIGN", "FLOOR", "CEIL", "FMOD", "FMIN",
    "FMAX", "HYPOT", "LT", "LE", "EQ", "NE", "NOT", "AND", "OR", "ASSIGN", "IF_ELSE_ZERO",
)  # fmt: skip
_CONSTANT, _ADD_OUTPUT, _FIRST_OF_CASADI = map(OPERATIONS.index, ("CONSTANT", "ADD_OUTPUT", "ADD"))

_long, _address = ctypes.c_int64, ctypes.c_void_p


class _FunctionStructure(ctypes.Structure):
    _fields_ = (
        ("steps", _long), ("step", _address), ("constants", _address), ("work", _long), ("places", _address),
        ("scales", _address),
    )  # fmt: skip


class TermStructure(ctypes.Structure):
    """`Term` in ``term_evaluation.c``."""

    _fields_ = (
        ("instances", _long), ("columns", _address), ("numbers", _address), ("rows", _address), ("scales", _address),
        ("value", _FunctionStructure), ("gradient", _FunctionStructure), ("hessian", _FunctionStructure),
    )  # fmt: skip


class SumsStructure(ctypes.Structure):
    """`Sums` in ``term_evaluation.c``."""

    _fields_ = (
        ("rows", _long), ("entries", _long), ("terms", _long), ("term", _address),
        ("offsets", _address), ("linear_starts", _address), ("linear_columns", _address),
        ("linear_coefficients", _address), ("constant_entries", _address), ("work", _long),
    )  # fmt: skip


@functools.cache
def _library() -> ctypes.CDLL | None:
    path = shared_library(TERM_EVALUATION)
    if path is None:
        return None
    library = ctypes.CDLL(str(path))
    for name, arguments in {"sums_values": 3, "sums_jacobian": 3, "sums_hessian": 4}.items():
        function = getattr(library, name)
        function.argtypes, function.restype = [_address] * arguments, ctypes.c_int32
    return library


def evaluation_library() -> ctypes.CDLL | None:
    """The compiled evaluation; None where it is switched off or was not compiled, and CasADi evaluates."""
    return _library() if native_allowed() else None


def how_terms_are_evaluated() -> str:
    """One line for people: the compiled evaluation and its file, or CasADi and why."""
    if evaluation_library() is None:
        return f"evaluated by CasADi: PYROBOCOP_NATIVE is 'off', or nothing was compiled; {HOW_TO_COMPILE}"
    return f"evaluated by compiled code: {library_file(TERM_EVALUATION)}"


def indices(values: np.ndarray) -> np.ndarray:
    """Places as the library reads them."""
    return np.ascontiguousarray(values, dtype=np.int32)


class CompiledFunction:
    """The steps of a CasADi function.

    Parameters
    ----------
    function : casadi.Function
        Of variables, numbers and weights; one output.

    Attributes
    ----------
    function : casadi.Function
    """

    def __init__(self, function: Any) -> None:
        count = function.n_instructions()
        steps = np.empty((count, 4), dtype=np.int32)
        constants: list[float] = []
        places = _places_of_operations()
        for k in range(count):
            operation = function.instruction_id(k)
            if operation == casadi.OP_INPUT:
                argument, row = function.instruction_input(k)
                steps[k] = argument, function.instruction_output(k)[0], row, 0
            elif operation == casadi.OP_OUTPUT:
                steps[k] = _ADD_OUTPUT, function.instruction_output(k)[1], function.instruction_input(k)[0], 0
            elif operation == casadi.OP_CONST:
                steps[k] = _CONSTANT, function.instruction_output(k)[0], len(constants), 0
                constants.append(function.instruction_constant(k))
            else:
                inputs = function.instruction_input(k)
                steps[k] = places[operation], function.instruction_output(k)[0], inputs[0], inputs[-1]
        self.function, self.steps, self.constants = function, steps, np.array(constants, dtype=float)
        self.work = function.sz_w()

    def structure(self, places: np.ndarray, scales: FloatArray | None) -> _FunctionStructure:
        """As the library takes it, with where it adds the outputs; arrays of shape (outputs, instances), flat.

        The caller keeps both arrays; no scales stand for ones.
        """
        return _FunctionStructure(
            len(self.steps), self.steps.ctypes.data, self.constants.ctypes.data, self.work, places.ctypes.data,
            None if scales is None else scales.ctypes.data,
        )  # fmt: skip


@functools.cache
def _places_of_operations() -> dict[int, int]:
    names = enumerate(OPERATIONS[_FIRST_OF_CASADI:], _FIRST_OF_CASADI)
    places = {getattr(casadi, f"OP_{name}"): place for place, name in names}
    places[casadi.OP_CONSTPOW] = places[casadi.OP_POW]
    return places


# --------------------------------------------------------------------------------------------------------- summed terms


class TermFunction:
    """The terms of one shape, evaluated all at once.

    Arrays of the values of one evaluation, and what belongs to each value, have shape (values, terms) and are flat.

    Parameters
    ----------
    terms : TermArrays

    Attributes
    ----------
    functions : tuple of CompiledFunction
        Its value, the nonzeros of its gradient and of its Hessian, as functions of variables, numbers and weights.
    columns, numbers, rows, scales : arrays
        Variables, numbers, and rows and scales of the values. Numbers may change between evaluations, in place.
    instances : int
    parameters, places_of_parameters : int arrays
        Parameters that are read, and where each stands among the numbers.
    gradient_pairs : pair of int arrays
        Rows and variables of the values of the gradient.
    hessian_pairs : pair of int arrays
        Variables of the values of the Hessian; the first is not smaller.
    output_scales : tuple of float arrays, or None for ones
        What each function's outputs are multiplied by.
    places : tuple of int arrays
        Where each function's outputs are added, once `structure` was told.
    """

    def __init__(self, terms: TermArrays) -> None:
        columns, numbers, parameters = terms.columns, terms.numbers, terms.parameters
        self.instances, size = columns.shape
        # Numbers that are the same everywhere become part of the function; the others are arguments.
        varies = ((numbers != numbers[:1]) | (parameters >= 0)).any(axis=0)
        derivatives = _derivatives(terms.code, size, np.where(varies, 0.0, numbers[0]).tobytes(), varies.tobytes())
        self.functions = derivatives.functions

        def flat(values: np.ndarray) -> np.ndarray:
            return np.ascontiguousarray(values.T).ravel()

        variable = derivatives.gradient
        self.gradient_pairs = np.tile(terms.rows, variable.size), flat(columns[:, variable])
        first, second = (flat(columns[:, variables]) for variables in derivatives.hessian)
        self.hessian_pairs = np.maximum(first, second), np.minimum(first, second)

        known = flat(parameters[:, varies])
        self.places_of_parameters = np.flatnonzero(known >= 0)
        self.parameters = known[self.places_of_parameters]
        self.columns, self.numbers = indices(flat(columns)), flat(numbers[:, varies])
        self.rows, self.scales = indices(terms.rows), terms.scales
        self.output_scales = terms.scales, np.tile(terms.scales, variable.size), None

    def structure(self, gradient_places: np.ndarray, hessian_places: np.ndarray) -> TermStructure:
        """As the library takes it, with the places of the gradient's and the Hessian's entries."""
        self.places = self.rows, indices(gradient_places), indices(hessian_places)
        functions = map(CompiledFunction.structure, self.functions, self.places, self.output_scales)
        arrays = self.columns, self.numbers, self.rows, self.scales
        return TermStructure(self.instances, *(array.ctypes.data for array in arrays), *functions)

    def add(self, which: int, x: FloatArray, weights: Any, sums: FloatArray) -> None:
        """As the library adds the outputs of one of the functions, by CasADi."""
        columns, numbers = (array.reshape(-1, self.instances) for array in (self.columns, self.numbers))
        of_rows = np.zeros(self.instances) if weights is None else weights[self.rows] * self.scales
        function, scales = self.functions[which].function, self.output_scales[which]
        values = function.map(self.instances)(x[columns], numbers, of_rows[None]).full().ravel()
        np.add.at(sums, self.places[which], values if scales is None else scales * values)

    def set_parameters(self, values: FloatArray) -> None:
        """Evaluate with these values of all parameters from now on."""
        self.numbers[self.places_of_parameters] = values[self.parameters]


class _Derivatives(NamedTuple):
    """A shape's value and derivatives, and the variables that the nonzeros of these belong to."""

    functions: tuple[CompiledFunction, ...]
    gradient: np.ndarray
    hessian: tuple[np.ndarray, np.ndarray]


@functools.lru_cache(maxsize=256)
def _derivatives(code: Code, size: int, first_numbers: bytes, varies: bytes) -> _Derivatives:
    """Derive a shape once, for all programs: the numbers of its first term, and which of them are arguments."""
    arguments = np.frombuffer(varies, dtype=bool)
    sizes = {"x": size, "p": int(np.count_nonzero(arguments)), "w": 1}
    x, p, w = (casadi.SX.sym(name, size) for name, size in sizes.items())
    free, given = iter(p.elements()), np.frombuffer(first_numbers).tolist()
    numbers = [next(free) if changes else given[i] for i, changes in enumerate(arguments.tolist())]
    # What a term has twice is found before it is differentiated: it is then differentiated once.
    output = casadi.cse(casadi.SX(decoded(code, x.elements(), numbers, _symbolic_functions())))
    gradient = casadi.jacobian(output, x)
    hessian = casadi.tril(casadi.hessian(w * output, x)[0])
    nonzeros = casadi.densify(output).nonzeros(), gradient.nonzeros(), hessian.nonzeros()
    results = [casadi.cse(casadi.vertcat(*some)) for some in nonzeros]
    functions = tuple(CompiledFunction(casadi.Function("term", [x, p, w], [result])) for result in results)
    return _Derivatives(functions, _triplet(gradient)[1], _triplet(hessian))


def _triplet(matrix: Any) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = (np.array(some, dtype=np.intp) for some in matrix.sparsity().get_triplet())
    return rows, columns


@functools.cache
def _symbolic_functions() -> dict[str, Callable[..., Any]]:
    """What functions mean for CasADi's symbols; CasADi is imported by the first term and not before."""
    other_names = {"abs": "fabs", "choose": "if_else"}
    functions = {name: getattr(casadi, other_names.get(name, name)) for name in (*NUMPY_NAMES, "choose")}
    return functions | comparisons(casadi.logic_and)


class SummedTerms:
    """Rows that are each a constant, a linear function and terms of some groups.

    Parameters
    ----------
    terms : Terms
    rows, n : int
        Counts of rows and variables.
    library : ctypes.CDLL or None
        The compiled evaluation; without it CasADi evaluates.

    Attributes
    ----------
    rows : int
    functions : list of TermFunction
    constants : float array
        Of the rows.
    offsets : float array
        The same with parameters that are added to rows.
    given : tuple of arrays
        Rows, parameters and coefficients of these.
    linear : tuple of arrays
        Where the linear part of each row begins and ends, then its columns and coefficients.
    constant_entries : float array
        What linear parts give to each entry of the Jacobian.
    structure : pair of int arrays
        Rows and columns of the Jacobian's entries.
    hessian_pairs : list of pairs of int arrays
        Variables of the entries that each function adds to a Hessian.
    work : int
        Numbers of one instance that an evaluation holds at a time.
    sums : SumsStructure
        All this as the library takes it, once `place_hessians` has told the places of the Hessian's entries.
    """

    def __init__(self, terms: Terms, rows: int, n: int, library: ctypes.CDLL | None = None) -> None:
        try:
            self.functions = [TermFunction(group.arrays()) for group in terms.groups.values()]
        except ArithmeticError as error:  # among the numbers: those of variables are symbols here
            raise EvaluationError(f"a number in an expression does not exist: {error}") from None
        self.rows, self._library = rows, library
        self.constants = np.zeros(rows)
        for row, constant in terms.constants.items():
            self.constants[row] = constant
        self.offsets = self.constants.copy()
        (linear_rows, columns, coefficients), self.given = terms.linear_parts()
        order = np.argsort(linear_rows, kind="stable")
        order = order[coefficients[order] != 0.0]
        linear_rows, columns, coefficients = linear_rows[order], columns[order], coefficients[order]
        starts = np.searchsorted(linear_rows, np.arange(rows + 1)).astype(np.int64)
        self.linear = starts, indices(columns), coefficients
        nonlinear = [function.gradient_pairs for function in self.functions]
        self.structure, places = merged_places([(linear_rows, columns), *nonlinear], n)
        of_linear, *self._gradient_places = _split(places, [order.size, *(rows.size for rows, _ in nonlinear)])
        self.constant_entries = np.bincount(of_linear, coefficients, self.structure[0].size).astype(float)
        self.hessian_pairs = [function.hessian_pairs for function in self.functions]
        self.work = max([1, *(function.work for term in self.functions for function in term.functions)])

    def place_hessian(self, places: np.ndarray) -> None:
        """Say where each entry of `hessian_pairs` is added, one function after the other."""
        hessian_places = _split(places, [rows.size for rows, _ in self.hessian_pairs])
        all_places = zip(self.functions, self._gradient_places, hessian_places, strict=True)
        self._terms = (TermStructure * len(self.functions))(*(term.structure(*both) for term, *both in all_places))
        starts, columns, coefficients = (array.ctypes.data for array in self.linear)
        self.sums = SumsStructure(
            self.rows, self.constant_entries.size, len(self.functions), ctypes.addressof(self._terms),
            self.offsets.ctypes.data, starts, columns, coefficients, self.constant_entries.ctypes.data, self.work,
        )  # fmt: skip
        self._place = ctypes.addressof(self.sums)

    def values(self, x: FloatArray) -> FloatArray:
        """Values of the rows."""
        if self._library is not None:
            return _filled(self._library.sums_values, self._place, x, np.empty(self.rows))
        starts, columns, coefficients = self.linear
        linear = scipy.sparse.csr_array((coefficients, columns, starts), shape=(self.rows, x.size))
        return self.offsets + self._added(0, x, linear @ x)

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Entries of their Jacobian."""
        if self._library is not None:
            return _filled(self._library.sums_jacobian, self._place, x, np.empty(self.constant_entries.size))
        return self._added(1, x, self.constant_entries.copy())

    def add_hessian(self, x: FloatArray, weights: FloatArray, entries: FloatArray) -> None:
        """Add the Hessian of weights @ rows to the entries."""
        if self._library is not None:
            _filled(self._library.sums_hessian, self._place, x, weights, entries)
        else:
            self._added(2, x, entries, weights)

    def _added(self, which: int, x: FloatArray, sums: FloatArray, weights: Any = None) -> FloatArray:
        """Without a library: the sums with the values of one of the functions of each term."""
        with np.errstate(all="ignore"):
            for term in self.functions:
                term.add(which, x, weights, sums)
        return sums

    def set_parameters(self, values: FloatArray) -> None:
        """Evaluate with these values of all parameters from now on."""
        rows, parameters, coefficients = self.given
        with np.errstate(all="ignore"):  # what is not finite is noticed in the sums
            given = coefficients * values[parameters]
        self.offsets[:] = self.constants + np.bincount(rows, given, self.constants.size)
        for function in self.functions:
            function.set_parameters(values)


def place_hessians(several: Sequence[SummedTerms], n: int) -> tuple[IndexArray, IndexArray]:
    """Give the Hessians of several sums the same entries, and return their rows and columns; n variables."""
    structure, places = merged_places([pair for sums in several for pair in sums.hessian_pairs], n)
    sizes = [sum(rows.size for rows, _ in sums.hessian_pairs) for sums in several]
    for sums, own in zip(several, _split(places, sizes), strict=True):
        sums.place_hessian(own)
    return structure


def _filled(function: Callable[..., int], place: int, *arrays: FloatArray) -> FloatArray:
    """The last array, once a function of the library has filled it from those before."""
    contiguous = [np.ascontiguousarray(array, dtype=np.float64) for array in arrays]
    if not function(place, *(array.ctypes.data for array in contiguous)):
        raise MemoryError("no memory is left for an evaluation.")
    return contiguous[-1]


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
