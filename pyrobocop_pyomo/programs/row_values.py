"""Values of many expressions at once, those of one shape as arrays; and how far many variables are from their bounds.

They are the user's own expressions, read from the model and evaluated by NumPy at what the model's variables hold:
nothing of what a solver was given is used, neither its functions nor its derivatives.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from operator import attrgetter
from typing import Any

import numpy as np
from pyomo.common.gc_manager import PauseGC
from pyomo.core.expr.numeric_expr import NegationExpression, SumExpression

from pyrobocop_pyomo.errors import EvaluationError, ModelError
from pyrobocop_pyomo.modeling.expression_nodes import ARRAY_FUNCTIONS, CALL
from pyrobocop_pyomo.modeling.functions import is_function_call
from pyrobocop_pyomo.modeling.pyomo_internals import function_of_call
from pyrobocop_pyomo.modeling.row_violations import number_or_nan
from pyrobocop_pyomo.modeling.rows_by_rule import RepeatedSum, RowByRule, content_of, sum_by_rule, sums_of
from pyrobocop_pyomo.modeling.shared_nodes import topmost_nodes
from pyrobocop_pyomo.numerics import Array

from .model_checks import number_in
from .term_groups import Columns, NodeKinds, NonlinearTerm, TermGroup, TermGroups, decoded, repetitions

_VALUE = attrgetter("value")


class RowValues:
    """Evaluates expressions that do not change, nor what they name; what variables hold is read each time.

    Parameters
    ----------
    expressions : sequence of expressions, variables or numbers
        Rows and sums that follow a rule stand for themselves.
    """

    def __init__(self, expressions: Sequence[Any]) -> None:
        self._expressions = expressions
        self._columns = Columns()
        kinds = NodeKinds()
        kinds.calls = CALL  # they are evaluated
        self._groups = TermGroups(self._columns, kinds, _content)
        self._single: Sequence[int] = ()
        with PauseGC():
            try:
                for i, expression in enumerate(expressions):
                    if (by_rule := sum_by_rule(expression)) is not None:
                        repeated = by_rule.repeated()
                        self._put_repeated(repeated._replace(rows=[i] * len(repeated.rows)))
                    elif expression.__class__ is not RowByRule:
                        self._groups.put(NonlinearTerm((expression,)), [i], [1.0], {})
                for repeated in sums_of(expressions):
                    self._put_repeated(repeated)
            except ModelError:  # something that arrays do not know: an external function
                self._groups.clear()
                self._single = range(len(expressions))
        self._shapes = list(map(TermGroup.arrays, self._groups.values()))

    def _put_repeated(self, repeated: RepeatedSum) -> None:
        for places, exchanged in repetitions(self._columns.table(repeated)):
            term = NonlinearTerm((repeated.expression(places[0]),))
            rows, scales = zip(*((repeated.rows[place], repeated.scales[place]) for place in places), strict=True)
            self._groups.put(term, list(rows), list(scales), exchanged)

    def values(self) -> Array:
        """Values now; NaN where an expression has none, or is no real number."""
        variables, parameters = (
            [leaf.value for leaf in leaves] for leaves in (self._columns.variables, self._columns.parameters)
        )
        if None in variables or None in parameters:
            return np.array([self._alone(i) for i in range(len(self._expressions))], dtype=float)
        found, left = np.zeros(len(self._expressions)), [*self._single]
        leaves = np.array(variables, dtype=float), np.array(parameters, dtype=float)
        for shape in self._shapes:
            numbers = shape.numbers
            if leaves[1].size:
                numbers = np.where(shape.parameters < 0, numbers, leaves[1][shape.parameters])
            arguments = list(leaves[0][shape.columns.T]), list(numbers.T)
            try:
                # An operation without a value is an error in Python, and must not disappear in a finite result.
                with np.errstate(divide="raise", over="raise", invalid="raise"):
                    np.add.at(found, shape.rows, shape.scales * decoded(shape.code, *arguments, ARRAY_FUNCTIONS))
            except (FloatingPointError, EvaluationError):
                left += shape.rows.tolist()
        for i in dict.fromkeys(left):
            found[i] = self._alone(i)
        return found

    def _alone(self, i: int) -> float:
        return number_or_nan(content_of(self._expressions[i]))


def _content(node: Any) -> Any:
    """What a name stands for, or which function is called."""
    if node.is_named_expression_type():
        return node.args[0]
    if not is_function_call(node):
        raise ModelError(f"'{node}' is a call.")
    return function_of_call(node)


def largest_terms(expressions: Iterable[Any]) -> Array:
    """Magnitude of the largest term that each expression adds up now, numbers apart, and those without a value.

    How well a sum can be met depends on it.

    Parameters
    ----------
    expressions : iterable of expressions, variables or numbers
    """
    terms = (map(number_or_nan, topmost_nodes((expression,), _is_term)) for expression in expressions)
    return np.array([np.fmax.reduce(np.abs([0.0, *several])) for several in terms], dtype=float)


def _is_term(node: Any) -> bool:
    if not node.is_expression_type():
        return True
    return not (node.is_named_expression_type() or isinstance(node, (SumExpression, NegationExpression)))


class BoundArrays:
    """Bounds of variables as arrays, infinite where there is none.

    Parameters
    ----------
    variables : sequence of VarData

    Attributes
    ----------
    lower, upper : float arrays
    """

    def __init__(self, variables: Sequence[Any]) -> None:
        self._variables = variables
        self.lower, self.upper = np.empty(len(variables)), np.empty(len(variables))
        self.read()

    def read(self) -> None:
        """Read the bounds again."""
        bounds = list(map(_bounds_of, self._variables))
        self.lower[:] = [-np.inf if lower is None else lower for lower, _ in bounds]
        self.upper[:] = [np.inf if upper is None else upper for _, upper in bounds]


def _bounds_of(variable: Any) -> tuple[float | None, float | None]:
    try:
        found: tuple[float | None, float | None] = variable.bounds
    except (ArithmeticError, ValueError, TypeError):
        for bound in (variable.lower, variable.upper):
            number_in(bound, variable.name)  # Pyomo's own message would not say which variable it is
        raise
    return found


class VariableBounds:
    """How far variables are from their bounds.

    Parameters
    ----------
    variables : iterable of VarData

    Attributes
    ----------
    variables : list of VarData
        Those that have bounds when this is made.
    """

    def __init__(self, variables: Iterable[Any]) -> None:
        self.variables = [variable for variable in variables if variable.bounds != (None, None)]
        self._bounds = BoundArrays(self.variables)

    def violations(self) -> Array:
        """Of each variable at the value that it has now; 0 where it has none, infinite for NaN."""
        self._bounds.read()
        numbers = list(map(_VALUE, self.variables))
        values = np.array(numbers, dtype=float)  # None becomes NaN
        violations = np.maximum(np.maximum(self._bounds.lower - values, values - self._bounds.upper), 0.0)
        violations[np.isnan(violations)] = np.inf
        if None in numbers:
            violations[[number is None for number in numbers]] = 0.0
        return violations

    def sizes(self) -> Array:
        """Magnitude of each variable at the value that it has now, or 1 where that is larger."""
        values = np.array(list(map(_VALUE, self.variables)), dtype=float)
        return np.fmax(np.abs(values), 1.0)
