"""Values and derivatives of groups of terms: one small function for each shape, derived by CasADi, for all terms.

A function is a list of steps. The compiled evaluation (``term_evaluation.c``) begins a step in some nanoseconds and
goes over all instances in the processor's nearest memory. Where it is not there, NumPy does the steps, each of which
begins in half a microsecond.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, ClassVar

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.modeling.expression_nodes import comparisons
from pyrobocop_pyomo.optional_imports import casadi

from .compiled_terms import CompiledFunction, CompiledTerm, VectorisedFunction
from .expression_codes import decoded
from .nonlinear_program import FloatArray
from .term_groups import TermArrays, TermGroup


class TermFunction:
    """The terms of one shape, evaluated all at once.

    Arrays of the values of one evaluation, and what belongs to each value, have shape (values, terms) and are flat.

    Parameters
    ----------
    terms : TermArrays
    compiled : bool
        Whether the compiled evaluation takes it; `value`, `gradient` and `hessian` then do not exist.

    Attributes
    ----------
    compiled : CompiledTerm or None
    rows : int array
        Where each term is added.
    scales : float array
        The factors that it is added with.
    parameters, places_of_parameters : int arrays
        Parameters that are read, and where each stands among the numbers of `compiled`.
    gradient_rows, gradient_columns : int arrays
        Rows and variables of the values that `gradient` returns.
    gradient_scales : float array
        The factors that those values are to be multiplied with.
    hessian_rows, hessian_columns : int arrays
        Pairs of variables of the values that `hessian` returns; the first is not smaller.
    """

    def __init__(self, terms: TermArrays, compiled: bool = False) -> None:
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

        self.rows, self.scales, self._columns = terms.rows, terms.scales, flat(columns)
        variable = np.array(gradient.sparsity().get_triplet()[1], dtype=np.intp)
        self.gradient_rows, self.gradient_columns = np.tile(terms.rows, variable.size), flat(columns[:, variable])
        self.gradient_scales = np.tile(terms.scales, variable.size)
        triplet = hessian.sparsity().get_triplet()
        first, second = (flat(columns[:, np.array(indices, dtype=np.intp)]) for indices in triplet)
        self.hessian_rows, self.hessian_columns = np.maximum(first, second), np.minimum(first, second)

        known = flat(parameters[:, varies])
        self.places_of_parameters = np.flatnonzero(known >= 0)
        self.parameters = known[self.places_of_parameters]
        self._x, self._w, self._numbers = np.zeros(columns.size), np.zeros(instances), flat(numbers[:, varies])
        results = [
            casadi.cse(casadi.vertcat(*nonzeros))
            for nonzeros in (casadi.densify(output).nonzeros(), gradient.nonzeros(), hessian.nonzeros())
        ]
        functions = [CompiledFunction(casadi.Function("term", [x, p, w], [result])) for result in results]
        self.compiled: CompiledTerm | None = None
        if compiled:
            self.compiled = CompiledTerm(
                functions, self._columns, self._numbers, self.rows, self.scales, self.gradient_scales, instances
            )
            return
        arrays = [values.reshape(-1, instances) for values in (self._x, self._numbers, self._w)]
        self._value, self._gradient, self._hessian = (
            VectorisedFunction(function, result.numel(), arrays)
            for function, result in zip(functions, results, strict=True)
        )

    def set_parameters(self, values: FloatArray) -> None:
        """Evaluate with these values of all parameters from now on."""
        self._numbers[self.places_of_parameters] = values[self.parameters]

    def value(self, x: FloatArray) -> FloatArray:
        """Value of each term, without its scale; overwritten by the next evaluation."""
        x.take(self._columns, out=self._x, mode="clip")
        return self._value().ravel()

    def gradient(self, x: FloatArray) -> FloatArray:
        """Nonzeros of the gradients, without scales; overwritten by the next evaluation."""
        x.take(self._columns, out=self._x, mode="clip")
        return self._gradient().ravel()

    def hessian(self, x: FloatArray, weights: FloatArray) -> FloatArray:
        """Hessians of the terms times their scales and the weights of their rows."""
        x.take(self._columns, out=self._x, mode="clip")
        weights.take(self.rows, out=self._w, mode="clip")
        self._w *= self.scales
        return self._hessian().ravel()


def _output(terms: TermArrays, x: Any, p: Any, varies: np.ndarray) -> Any:
    free, given = iter(p.elements()), terms.numbers[0].tolist()
    numbers = [next(free) if changes else given[i] for i, changes in enumerate(varies.tolist())]
    # What a term has twice is found before it is differentiated: it is then differentiated once.
    return casadi.cse(casadi.SX(decoded(terms.code, x.elements(), numbers, _SYMBOLIC_FUNCTIONS)))


def term_functions(groups: Iterable[TermGroup], *, compiled: bool) -> list[TermFunction]:
    """One function for each shape.

    Parameters
    ----------
    groups : iterable of TermGroup
    compiled : bool
        Whether the compiled evaluation takes them.

    Raises
    ------
    EvaluationError
        When a number in an expression does not exist.
    """
    try:
        return [TermFunction(group.arrays(), compiled) for group in groups]
    except ArithmeticError as error:  # among the numbers: those of variables are symbols here
        raise EvaluationError(f"a number in an expression does not exist: {error}") from None


class _SymbolicFunctions(dict[str, Callable[..., Any]]):
    """Functions on CasADi's symbols by name, so that CasADi is imported by the first term and not before."""

    _OTHER_NAMES: ClassVar = {"abs": "fabs", "choose": "if_else"}

    def __init__(self) -> None:
        super().__init__(comparisons(lambda a, b: casadi.logic_and(a, b)))

    def __missing__(self, name: str) -> Callable[..., Any]:
        function: Callable[..., Any] = getattr(casadi, self._OTHER_NAMES.get(name, name))
        return function


_SYMBOLIC_FUNCTIONS = _SymbolicFunctions()
