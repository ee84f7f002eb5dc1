"""Values and derivatives of groups of terms: one small function for each shape, derived by CasADi, for all terms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np

from pyrobocop_pyomo.optional_imports import casadi

from .expression_codes import comparisons, decoded
from .nonlinear_program import FloatArray
from .term_groups import TermGroup
from .vectorised_function import InterpretedFunction, VectorisedFunction

# Shapes with fewer terms than this share one function: one of its own would do little at each of its steps.
FEWEST_TERMS = 12


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

        output, variable = (np.array(each, dtype=np.intp) for each in gradient.sparsity().get_triplet())
        self.gradient_rows, self.gradient_columns = rows[output].ravel(), columns[variable].ravel()
        self.gradient_scales = scales[output].ravel()
        first, second = (columns[np.array(each, dtype=np.intp)].ravel() for each in hessian.sparsity().get_triplet())
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
    """One function for each large group, and one for all terms of the small ones together."""
    small = [group for group in groups if len(group.rows) < FEWEST_TERMS]
    functions = [_repeated(group) for group in groups if len(group.rows) >= FEWEST_TERMS]
    return [*functions, _assorted(small)] if small else functions


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
