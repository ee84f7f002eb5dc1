"""A function that CasADi has derived, evaluated by NumPy for thousands of arguments at once.

CasADi's virtual machine takes three nanoseconds for each operation on each argument; NumPy, one operation on all
arguments after the other, takes half a nanosecond for arithmetic. Compiling would be as quick, but takes seconds and a
compiler.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from pyrobocop_pyomo.optional_imports import casadi

from .nonlinear_program import FloatArray

# Names of CasADi's operations and of the NumPy functions that do the same.
_UFUNCS = {
    "ADD": "add", "SUB": "subtract", "MUL": "multiply", "DIV": "divide", "NEG": "negative", "INV": "reciprocal",
    "SQ": "square", "SQRT": "sqrt", "POW": "power", "CONSTPOW": "power", "EXP": "exp", "LOG": "log",
    "LOG1P": "log1p", "EXPM1": "expm1", "SIN": "sin", "COS": "cos", "TAN": "tan", "ASIN": "arcsin",
    "ACOS": "arccos", "ATAN": "arctan", "ATAN2": "arctan2", "SINH": "sinh", "COSH": "cosh", "TANH": "tanh",
    "ASINH": "arcsinh", "ACOSH": "arccosh", "ATANH": "arctanh", "FABS": "absolute", "SIGN": "sign",
    "COPYSIGN": "copysign", "FLOOR": "floor", "CEIL": "ceil", "FMOD": "fmod", "FMIN": "fmin", "FMAX": "fmax",
    "HYPOT": "hypot", "LT": "less", "LE": "less_equal", "EQ": "equal", "NE": "not_equal", "NOT": "logical_not",
    "AND": "logical_and", "OR": "logical_or", "ASSIGN": "positive",
}  # fmt: skip


class VectorisedFunction:
    """A function of scalars, evaluated on rows of arguments: one row for each scalar, one column for each instance.

    Parameters
    ----------
    symbols : list of SX
        Vectors of symbols.
    result : SX
        A vector of expressions in the symbols.
    arrays : list of float arrays, shapes (size of the symbol, instances)
        Where the arguments are read at each evaluation.
    """

    def __init__(self, symbols: Sequence[Any], result: Any, arrays: Sequence[FloatArray]) -> None:
        function = casadi.Function("vectorised", list(symbols), [result])
        instances = arrays[0].shape[1]
        work = np.empty((function.sz_w(), instances))
        self._result = np.empty((result.numel(), instances))
        self._steps: list[tuple[Callable[..., Any], tuple[Any, ...]]] = []
        for k in range(function.n_instructions()):
            operation = function.instruction_id(k)
            if operation == casadi.OP_INPUT:
                argument, row = function.instruction_input(k)
                step = np.copyto, (work[function.instruction_output(k)[0]], arrays[argument][row])
            elif operation == casadi.OP_OUTPUT:
                step = (
                    np.copyto,
                    (self._result[function.instruction_output(k)[1]], work[function.instruction_input(k)[0]]),
                )
            elif operation == casadi.OP_CONST:
                step = np.copyto, (work[function.instruction_output(k)[0]], function.instruction_constant(k))
            else:
                rows = (*function.instruction_input(k), *function.instruction_output(k))
                step = _numpy_functions()[operation], tuple(work[row] for row in rows)
            self._steps.append(step)

    def __call__(self) -> FloatArray:
        """Values for the arguments that stand in the arrays, shape (size of the result, instances)."""
        with np.errstate(all="ignore"):  # what is not finite is noticed in the sums
            for function, arguments in self._steps:
                function(*arguments)
        return self._result


class InterpretedFunction:
    """The same for a single instance, by CasADi's virtual machine: many operations on one argument each."""

    def __init__(self, symbols: Sequence[Any], result: Any, arrays: Sequence[FloatArray]) -> None:
        function = casadi.Function("interpreted", list(symbols), [result])
        self._result = np.empty((result.numel(), 1))
        self._arrays = arrays  # their memory is used for as long as the function is
        self._buffer, self._evaluate = function.buffer()
        for i, array in enumerate(arrays):
            self._buffer.set_arg(i, array.data)
        self._buffer.set_res(0, self._result.data)

    def __call__(self) -> FloatArray:
        """Values for the arguments that stand in the arrays, shape (size of the result, 1)."""
        self._evaluate()
        return self._result


@cache
def _numpy_functions() -> dict[int, Callable[..., Any]]:
    functions: dict[int, Callable[..., Any]] = {
        getattr(casadi, f"OP_{ours}"): getattr(np, its) for ours, its in _UFUNCS.items()
    }
    functions[casadi.OP_TWICE] = lambda a, out: np.add(a, a, out)
    functions[casadi.OP_IF_ELSE_ZERO] = lambda chosen, a, out: np.copyto(out, np.where(chosen, a, 0.0))
    return functions
