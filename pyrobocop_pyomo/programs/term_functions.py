"""Values and derivatives of groups of terms: one small function for each shape, derived by CasADi, for all terms.

NumPy evaluates a derived function for thousands of arguments at once. CasADi's virtual machine takes three nanoseconds
for each operation on each argument; NumPy, one operation on all arguments after the other, takes half a nanosecond for
arithmetic. Compiling would be as quick, but takes seconds and a compiler.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, ClassVar

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.modeling.expression_nodes import comparisons
from pyrobocop_pyomo.optional_imports import casadi

from .expression_codes import decoded
from .nonlinear_program import FloatArray
from .term_groups import TermGroup

# Shapes with fewer terms than this share one function: one of its own would do little at each of its steps.
FEWEST_TERMS = 12

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


class TermFunction:
    """Functions of one shape, evaluated over many sets of variables and numbers at once.

    An *instance* is one set of variables with one set of numbers; its functions are its *outputs*. In arrays each
    instance is a column.

    Parameters
    ----------
    columns : int array, shape (variables, instances)
        Variables of each instance.
    numbers : float array, shape (numbers, instances)
        Numbers of each instance.
    parameters : int array, shape (3, count)
        Rows and columns in `numbers`, and the parameters that stand there.
    build : callable
        From lists of symbols for the variables and of symbols and floats for the numbers to a list of outputs.
    rows : int array, shape (outputs, instances)
        Where each output is added.
    scales : float array, shape (outputs, instances)
        The factors that it is added with.

    Attributes
    ----------
    gradient_rows, gradient_columns : int arrays
        Rows and variables of the values that `gradient` returns.
    gradient_scales : float array
        The factors that those values are to be multiplied with.
    hessian_rows, hessian_columns : int arrays
        Pairs of variables of the values that `hessian` returns; the first is not smaller.
    """

    def __init__(
        self,
        columns: np.ndarray,
        numbers: FloatArray,
        parameters: np.ndarray,
        build: Callable[[list[Any], list[Any]], list[Any]],
        rows: np.ndarray,
        scales: FloatArray,
    ) -> None:
        self._columns, self.rows, self.scales = columns, rows.ravel(), scales.ravel()
        # Numbers that are the same everywhere become part of the function; the others are arguments.
        varies = (numbers != numbers[:, :1]).any(axis=1)
        varies[parameters[0]] = True
        self._numbers = np.ascontiguousarray(numbers[varies])
        self._places = (np.cumsum(varies) - 1)[parameters[0]], parameters[1]
        self._parameters = parameters[2]
        sizes = {"x": columns.shape[0], "p": self._numbers.shape[0], "w": rows.shape[0]}
        x, p, w = (casadi.SX.sym(name, size) for name, size in sizes.items())
        free, given = iter(p.elements()), numbers[:, 0].tolist()
        symbols = [next(free) if changes else given[i] for i, changes in enumerate(varies.tolist())]
        outputs = casadi.vertcat(*build(x.elements(), symbols))
        gradient = casadi.jacobian(outputs, x)
        hessian = casadi.tril(casadi.hessian(casadi.dot(w, outputs), x)[0])

        output, variable = (np.array(indices, dtype=np.intp) for indices in gradient.sparsity().get_triplet())
        self.gradient_rows, self.gradient_columns = rows[output].ravel(), columns[variable].ravel()
        self.gradient_scales = scales[output].ravel()
        triplet = hessian.sparsity().get_triplet()
        first, second = (columns[np.array(indices, dtype=np.intp)].ravel() for indices in triplet)
        self.hessian_rows, self.hessian_columns = np.maximum(first, second), np.minimum(first, second)

        self._x, self._w = np.zeros(columns.shape), np.zeros(rows.size)
        arrays = [self._x, self._numbers, self._w.reshape(rows.shape)]
        evaluator = InterpretedFunction if columns.shape[1] == 1 else VectorisedFunction
        self._value, self._gradient, self._hessian = (
            evaluator([x, p, w], casadi.cse(casadi.vertcat(*nonzeros)), arrays)
            for nonzeros in (casadi.densify(outputs).nonzeros(), gradient.nonzeros(), hessian.nonzeros())
        )

    def set_parameters(self, values: FloatArray) -> None:
        """Evaluate with these values of all parameters from now on."""
        self._numbers[self._places] = values[self._parameters]

    def value(self, x: FloatArray) -> FloatArray:
        """Value of each output, without its scale; overwritten by the next evaluation."""
        x.take(self._columns, out=self._x, mode="clip")
        return self._value().ravel()

    def gradient(self, x: FloatArray) -> FloatArray:
        """Nonzeros of the gradients, without scales; overwritten by the next evaluation."""
        x.take(self._columns, out=self._x, mode="clip")
        return self._gradient().ravel()

    def hessian(self, x: FloatArray, weights: FloatArray) -> FloatArray:
        """Hessians of the sums of the outputs times their scales and the weights of their rows."""
        x.take(self._columns, out=self._x, mode="clip")
        weights.take(self.rows, out=self._w, mode="clip")
        self._w *= self.scales
        return self._hessian().ravel()


def term_functions(groups: Sequence[TermGroup]) -> list[TermFunction]:
    """One function for each large group, and one for all terms of the small ones together.

    Raises
    ------
    EvaluationError
        When a number in an expression does not exist.
    """
    small = [group for group in groups if len(group.rows) < FEWEST_TERMS]
    try:
        functions = [_repeated(group) for group in groups if len(group.rows) >= FEWEST_TERMS]
        return [*functions, _assorted(small)] if small else functions
    except ArithmeticError as error:  # among the numbers: those of variables are symbols here
        raise EvaluationError(f"a number in an expression does not exist: {error}") from None


def _repeated(group: TermGroup) -> TermFunction:
    terms = len(group.rows)
    places, parameters = np.array(group.parameters, dtype=np.intp).reshape(-1, 2).T
    instance, number = np.divmod(places, max(group.numbers_per_term, 1))
    return TermFunction(
        np.ascontiguousarray(np.array(group.columns, dtype=np.intp).reshape(terms, group.size).T),
        np.array(group.numbers, dtype=float).reshape(terms, group.numbers_per_term).T,
        np.array([number, instance, parameters]),
        lambda x, p: [decoded(group.code, x, p, _SYMBOLIC_FUNCTIONS)],
        np.array(group.rows, dtype=np.intp)[None],
        np.array(group.scales, dtype=float)[None],
    )


def _assorted(groups: Sequence[TermGroup]) -> TermFunction:
    """All terms as the outputs of one function with one instance."""
    columns = np.concatenate([np.array(group.columns, dtype=np.intp) for group in groups])
    numbers = np.concatenate([np.array(group.numbers, dtype=float) for group in groups])
    starts = np.cumsum([0, *(len(group.numbers) for group in groups[:-1])])
    places = [
        (start + place, 0, parameter)
        for start, group in zip(starts, groups, strict=True)
        for place, parameter in group.parameters
    ]

    def build(x: list[Any], p: list[Any]) -> list[Any]:
        outputs = []
        for group in groups:
            for i in range(len(group.rows)):
                inner = p[i * group.numbers_per_term : (i + 1) * group.numbers_per_term]
                variables = x[i * group.size : (i + 1) * group.size]
                outputs.append(decoded(group.code, variables, inner, _SYMBOLIC_FUNCTIONS))
            x, p = x[len(group.columns) :], p[len(group.numbers) :]
        return outputs

    rows = np.concatenate([np.array(group.rows, dtype=np.intp) for group in groups])
    scales = np.concatenate([np.array(group.scales, dtype=float) for group in groups])
    triplets = np.array(places, dtype=np.intp).reshape(-1, 3).T
    return TermFunction(columns[:, None], numbers[:, None], triplets, build, rows[:, None], scales[:, None])


class _SymbolicFunctions(dict[str, Callable[..., Any]]):
    """Functions on CasADi's symbols by name, so that CasADi is imported by the first term and not before."""

    _OTHER_NAMES: ClassVar = {"abs": "fabs", "choose": "if_else"}

    def __init__(self) -> None:
        super().__init__(comparisons(lambda a, b: casadi.logic_and(a, b)))

    def __missing__(self, name: str) -> Callable[..., Any]:
        function: Callable[..., Any] = getattr(casadi, self._OTHER_NAMES.get(name, name))
        return function


_SYMBOLIC_FUNCTIONS = _SymbolicFunctions()
