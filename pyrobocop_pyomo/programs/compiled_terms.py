"""Summed terms for the compiled evaluation in ``term_evaluation.c``.

That library knows nothing of a particular model: it is compiled once, and gets each model's functions as arrays. What
the structures here point to belongs to the objects that made it, and is kept alive by them.
"""

from __future__ import annotations

import ctypes
import functools
import logging
from pathlib import Path
from typing import Any

import numpy as np

from pyrobocop_pyomo.native.shared_library import HOW_TO_COMPILE, library_file, native_allowed, shared_library
from pyrobocop_pyomo.optional_imports import casadi

from .nonlinear_program import FloatArray

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
