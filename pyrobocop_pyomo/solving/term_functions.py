"""Values and derivatives of groups of terms by CasADi: one small function for each shape, mapped over all terms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np

from pyrobocop_pyomo.optional_imports import casadi

from .expression_codes import comparisons, decoded
from .expression_terms import TermGroup
from .nonlinear_program import FloatArray

# Shapes with fewer terms than this share one function: a function of its own costs a millisecond to make.
FEWEST_TERMS = 4


class TermFunction:
    """Functions of one shape, evaluated over many sets of variables and numbers at once.

    An *instance* is one set of variables with one set of numbers; its functions are its *outputs*. Arrays hold one
    instance behind the other.

    Parameters
    ----------
    columns : int array, shape (instances, variables)
        Variables of each instance.
    numbers : float array, shape (instances, numbers)
        Numbers of each instance.
    varies : bool array, shape (numbers,)
        Numbers that differ among the instances, or that may change later. The others become part of the function.
    build : callable
        From lists of symbols for the variables and of symbols and floats for the numbers to a list of outputs.
    rows : int array, shape (instances, outputs)
        Where each output is added.
    scales : float array, shape (instances, outputs)
        The factors that it is added with.
    parameters : int array, shape (count, 2)
        Places in the flat `numbers` and the parameters that stand there.

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
        varies: np.ndarray,
        build: Callable[[list[Any], list[Any]], list[Any]],
        rows: np.ndarray,
        scales: FloatArray,
        parameters: np.ndarray,
    ) -> None:
        instances, size = columns.shape
        self.columns, self.rows, self.scales = columns.ravel(), rows.ravel(), scales.ravel()
        self._numbers = numbers[:, varies].ravel()
        # Where the parameters stand once the numbers that are the same in all instances have gone.
        instance, number = np.divmod(parameters[:, 0], max(varies.size, 1))
        self._places = instance * np.count_nonzero(varies) + np.cumsum(varies)[number] - 1
        self._parameters = parameters[:, 1]
        p_size = int(np.count_nonzero(varies))
        x, p, w = (casadi.SX.sym(*each) for each in (("x", size), ("p", p_size), ("w", rows.shape[1])))
        free, given = iter(p.elements()), numbers[0].tolist()
        symbols = [next(free) if changes else given[i] for i, changes in enumerate(varies.tolist())]
        outputs = casadi.vertcat(*build(x.elements(), symbols))
        gradient = casadi.jacobian(outputs, x)
        hessian = casadi.tril(casadi.hessian(casadi.dot(w, outputs), x)[0])

        output, variable = (np.array(each, dtype=np.intp) for each in gradient.sparsity().get_triplet())
        self.gradient_rows = rows[:, output].ravel()
        self.gradient_columns = columns[:, variable].ravel()
        self.gradient_scales = scales[:, output].ravel()
        first, second = (np.array(each, dtype=np.intp) for each in hessian.sparsity().get_triplet())
        first, second = columns[:, first].ravel(), columns[:, second].ravel()
        self.hessian_rows, self.hessian_columns = np.maximum(first, second), np.minimum(first, second)

        self._x, self._w = np.zeros(columns.size), np.zeros(rows.size)
        inputs, arrays = [x, p], [self._x, self._numbers]
        self._value = _Mapped("value", inputs, casadi.densify(outputs), arrays, instances)
        self._gradient = _Mapped("gradient", inputs, gradient, arrays, instances)
        self._hessian = _Mapped("hessian", [*inputs, w], hessian, [*arrays, self._w], instances)

    def set_parameters(self, values: FloatArray) -> None:
        """Evaluate with these values of all parameters from now on."""
        self._numbers[self._places] = values[self._parameters]

    def value(self, x: FloatArray) -> FloatArray:
        """Value of each output, without its scale; overwritten by the next evaluation."""
        x.take(self.columns, out=self._x, mode="clip")
        return self._value()

    def gradient(self, x: FloatArray) -> FloatArray:
        """Nonzeros of the gradients, without scales; overwritten by the next evaluation."""
        x.take(self.columns, out=self._x, mode="clip")
        return self._gradient()

    def hessian(self, x: FloatArray, weights: FloatArray) -> FloatArray:
        """Hessians of the sums of the outputs times their scales and the weights of their rows."""
        x.take(self.columns, out=self._x, mode="clip")
        weights.take(self.rows, out=self._w, mode="clip")
        self._w *= self.scales
        return self._hessian()


class _Mapped:
    """A CasADi function of every instance that reads and writes NumPy memory, without conversions between."""

    def __init__(self, name: str, symbols: list[Any], result: Any, arrays: list[FloatArray], instances: int) -> None:
        nonzeros = casadi.cse(casadi.vertcat(*result.nonzeros()))
        function = casadi.Function(name, symbols, [nonzeros]).map(instances)
        self._result = np.zeros(nonzeros.numel() * instances)
        self._arrays = arrays  # their memory is used for as long as the function is
        self._buffer, self._evaluate = function.buffer()
        for i, array in enumerate(arrays):
            self._buffer.set_arg(i, array.data)
        self._buffer.set_res(0, self._result.data)

    def __call__(self) -> FloatArray:
        self._evaluate()
        return self._result


def term_functions(groups: Sequence[TermGroup]) -> list[TermFunction]:
    """One function for each large group, and one for all terms of the small ones together."""
    small = [group for group in groups if len(group.rows) < FEWEST_TERMS]
    functions = [_repeated(group) for group in groups if len(group.rows) >= FEWEST_TERMS]
    return [*functions, _assorted(small)] if small else functions


def _repeated(group: TermGroup) -> TermFunction:
    terms = len(group.rows)
    numbers = np.array(group.numbers, dtype=float).reshape(terms, group.numbers_per_term)
    varies = (numbers != numbers[0]).any(axis=0)
    parameters = np.array(group.parameters, dtype=np.intp).reshape(-1, 2)
    if parameters.size:
        varies[parameters[:, 0] % group.numbers_per_term] = True
    return TermFunction(
        np.array(group.columns, dtype=np.intp).reshape(terms, group.size),
        numbers,
        varies,
        lambda x, p: [decoded(group.code, x, p, _SYMBOLIC_FUNCTIONS)],
        np.array(group.rows, dtype=np.intp).reshape(terms, 1),
        np.array(group.scales, dtype=float).reshape(terms, 1),
        parameters,
    )


def _assorted(groups: Sequence[TermGroup]) -> TermFunction:
    """All terms as the outputs of one function with one instance."""
    columns = np.concatenate([np.array(group.columns, dtype=np.intp) for group in groups])
    numbers = np.concatenate([np.array(group.numbers, dtype=float) for group in groups])
    starts = np.cumsum([0, *(len(group.numbers) for group in groups)])
    parameters = np.array(
        [(start + place, i) for start, group in zip(starts, groups, strict=False) for place, i in group.parameters],
        dtype=np.intp,
    ).reshape(-1, 2)
    varies = np.zeros(numbers.size, dtype=bool)
    varies[parameters[:, 0]] = True

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
    return TermFunction(columns[None], numbers[None], varies, build, rows[None], scales[None], parameters)


class _SymbolicFunctions(dict[str, Callable[..., Any]]):
    """Functions on CasADi's symbols by name, so that CasADi is imported by the first term and not before."""

    _OTHER_NAMES: ClassVar = {"abs": "fabs", "choose": "if_else"}

    def __init__(self) -> None:
        super().__init__(comparisons(lambda a, b: casadi.logic_and(a, b)))

    def __missing__(self, name: str) -> Callable[..., Any]:
        function: Callable[..., Any] = getattr(casadi, self._OTHER_NAMES.get(name, name))
        return function


_SYMBOLIC_FUNCTIONS = _SymbolicFunctions()
