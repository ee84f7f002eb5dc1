"""Values and derivatives of groups of terms: one small function for each shape, derived by CasADi, for all terms.

A function is a list of steps. The compiled evaluation (``term_evaluation.c``) begins a step in some nanoseconds and
goes over all instances in the processor's nearest memory. Where it is not there, NumPy does the steps, each of which
begins in half a microsecond.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.modeling.expression_nodes import comparisons
from pyrobocop_pyomo.optional_imports import casadi

from .compiled_terms import CompiledFunction, CompiledTerm, VectorisedFunction
from .expression_codes import decoded
from .nonlinear_program import FloatArray
from .term_bundles import FEWEST_TERMS, Bundle, Output, bundles_of
from .term_groups import TermGroup


class TermFunction:
    """The outputs of a bundle, evaluated for all of its instances at once.

    Arrays of the values of one evaluation, and what belongs to each value, have shape (values, instances) and are flat.

    Parameters
    ----------
    bundle : Bundle
    compiled : bool
        Whether the compiled evaluation takes it; `value`, `gradient` and `hessian` then do not exist.

    Attributes
    ----------
    compiled : CompiledTerm or None
    rows : int array
        Where each output is added.
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

    def __init__(self, bundle: Bundle, compiled: bool = False) -> None:
        numbers = np.hstack([output.numbers for output in bundle.outputs])
        parameters = np.hstack([output.parameters for output in bundle.outputs])
        # Numbers that are the same everywhere become part of the function; the others are arguments.
        varies = ((numbers != numbers[:1]) | (parameters >= 0)).any(axis=0)
        columns = bundle.columns
        rows = np.column_stack([output.rows for output in bundle.outputs])
        scales = np.column_stack([output.scales for output in bundle.outputs])
        sizes = {"x": columns.shape[1], "p": int(np.count_nonzero(varies)), "w": rows.shape[1]}
        x, p, w = (casadi.SX.sym(name, size) for name, size in sizes.items())
        outputs = _outputs(bundle, x, p, numbers[0], varies)
        gradient = casadi.jacobian(outputs, x)
        hessian = casadi.tril(casadi.hessian(casadi.dot(w, outputs), x)[0])

        instances = columns.shape[0]

        def flat(values: np.ndarray) -> np.ndarray:
            return np.ascontiguousarray(values.T).ravel()

        self.rows, self.scales, self._columns = flat(rows), flat(scales), flat(columns)
        output, variable = (np.array(indices, dtype=np.intp) for indices in gradient.sparsity().get_triplet())
        self.gradient_rows, self.gradient_columns = flat(rows[:, output]), flat(columns[:, variable])
        self.gradient_scales = flat(scales[:, output])
        triplet = hessian.sparsity().get_triplet()
        first, second = (flat(columns[:, np.array(indices, dtype=np.intp)]) for indices in triplet)
        self.hessian_rows, self.hessian_columns = np.maximum(first, second), np.minimum(first, second)

        known = flat(parameters[:, varies])
        self.places_of_parameters = np.flatnonzero(known >= 0)
        self.parameters = known[self.places_of_parameters]
        self._x, self._w, self._numbers = np.zeros(columns.size), np.zeros(rows.size), flat(numbers[:, varies])
        results = [
            casadi.cse(casadi.vertcat(*nonzeros))
            for nonzeros in (casadi.densify(outputs).nonzeros(), gradient.nonzeros(), hessian.nonzeros())
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


def _outputs(bundle: Bundle, x: Any, p: Any, numbers: FloatArray, varies: np.ndarray) -> Any:
    free, given = iter(p.elements()), numbers.tolist()
    upcoming = iter([next(free) if changes else given[i] for i, changes in enumerate(varies.tolist())])
    variables = x.elements()
    outputs = []
    for output in bundle.outputs:
        inner = [next(upcoming) for _ in range(output.numbers.shape[1])]
        outer = [variables[k] for k in output.variables]
        outputs.append(decoded(output.code, outer, inner, _SYMBOLIC_FUNCTIONS))
    # What outputs share is found before it is differentiated: it is then differentiated once.
    return casadi.cse(casadi.vertcat(*outputs))


def term_functions(groups: Sequence[TermGroup], variables: int, *, compiled: bool) -> list[TermFunction]:
    """One function for each large bundle, and one for all terms of the small ones together.

    Parameters
    ----------
    groups : sequence of TermGroup
    variables : int
        Count of all variables.
    compiled : bool
        Whether the compiled evaluation takes them.

    Raises
    ------
    EvaluationError
        When a number in an expression does not exist.
    """
    bundles = bundles_of(groups, variables)
    large = [bundle for bundle in bundles if bundle.columns.shape[0] >= FEWEST_TERMS]
    small = [bundle for bundle in bundles if bundle.columns.shape[0] < FEWEST_TERMS]
    try:
        functions = [TermFunction(bundle, compiled) for bundle in large]
        return [*functions, TermFunction(_assorted(small), compiled)] if small else functions
    except ArithmeticError as error:  # among the numbers: those of variables are symbols here
        raise EvaluationError(f"a number in an expression does not exist: {error}") from None


def _assorted(bundles: Sequence[Bundle]) -> Bundle:
    """All terms of all instances as the outputs of one instance, each with variables of its own."""
    outputs: list[Output] = []
    start = 0
    for bundle in bundles:
        for i in range(bundle.columns.shape[0]):
            chosen = np.array([i])
            outputs += [replace(output.part(chosen), variables=output.variables + start) for output in bundle.outputs]
            start += bundle.columns.shape[1]
    return Bundle(np.concatenate([bundle.columns.ravel() for bundle in bundles])[None], outputs)


class _SymbolicFunctions(dict[str, Callable[..., Any]]):
    """Functions on CasADi's symbols by name, so that CasADi is imported by the first term and not before."""

    _OTHER_NAMES: ClassVar = {"abs": "fabs", "choose": "if_else"}

    def __init__(self) -> None:
        super().__init__(comparisons(lambda a, b: casadi.logic_and(a, b)))

    def __missing__(self, name: str) -> Callable[..., Any]:
        function: Callable[..., Any] = getattr(casadi, self._OTHER_NAMES.get(name, name))
        return function


_SYMBOLIC_FUNCTIONS = _SymbolicFunctions()
