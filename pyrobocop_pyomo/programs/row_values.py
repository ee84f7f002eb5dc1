"""Values of many expressions at once: those of one shape are evaluated as arrays.

They are the user's own expressions, read from the model and evaluated by NumPy at what the model's variables hold:
nothing of what a solver was given is used, neither its functions nor its derivatives.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from pyomo.common.gc_manager import PauseGC
from pyomo.core.expr.numeric_expr import NegationExpression, SumExpression
from pyomo.core.expr.numvalue import native_types

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.row_violations import number_or_nan
from pyrobocop_pyomo.modeling.shared_nodes import NodeValues, topmost_nodes
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases.rate_arrays import ARRAY_FUNCTIONS

from .expression_codes import Code, NodeKinds, decoded
from .term_groups import SMALLEST_BATCH, Batch, BatchedWalk

Places = NDArray[np.intp]

_VALUE = attrgetter("value")
# From so many terms on, a sum is evaluated as arrays.
MANY_TERMS = 100


@dataclass(eq=False)
class _Shape:
    """Expressions of one shape: variables, parameters and numbers stand in arrays, one column for each expression."""

    rows: Places
    code: Code
    leaves: Places  # places of variables among all leaves, shape (variables, expressions)
    numbers: list[Any]  # arrays, or None where parameters stand
    parameters: dict[int, Places]  # their places among all leaves


class RowValues:
    """Evaluates expressions that do not change; what variables and parameters hold is read each time.

    Parameters
    ----------
    expressions : sequence of expressions, variables or numbers
    """

    def __init__(self, expressions: Sequence[Any]) -> None:
        self._expressions = expressions
        self._leaves: list[Any] = []
        self._place_of: dict[int, int] = {}
        self._names: list[tuple[Any, Any]] = []
        self._shapes: list[_Shape] = []
        with PauseGC():
            self._single = self._walk()

    @property
    def is_current(self) -> bool:
        """Whether named expressions still stand for what they stood for."""
        return all(named._args_[0] is content for named, content in self._names)

    def values(self) -> Array:
        """Values now; NaN where an expression has none, or is no real number."""
        numbers = list(map(_VALUE, self._leaves))
        if None in numbers:
            return np.array(list(map(number_or_nan, self._expressions)), dtype=float)
        found = np.empty(len(self._expressions))
        for i in self._single:
            found[i] = number_or_nan(self._expressions[i])
        leaves = np.array(numbers, dtype=float)
        for shape in self._shapes:
            given = [leaves[shape.parameters[i]] if known is None else known for i, known in enumerate(shape.numbers)]
            try:
                # An operation without a value is an error in Python, and must not disappear in a finite result.
                with np.errstate(divide="raise", over="raise", invalid="raise"):
                    found[shape.rows] = decoded(shape.code, list(leaves[shape.leaves]), given, ARRAY_FUNCTIONS)
            except FloatingPointError:
                for i in shape.rows.tolist():
                    found[i] = number_or_nan(self._expressions[i])
        return found

    def _walk(self) -> list[int]:
        """Put expressions into shapes; returns those that are left."""
        left = dict.fromkeys(range(len(self._expressions)))
        first = Batch(items=range(len(self._expressions)), pending=[list(self._expressions)], code=[])
        if len(self._expressions) >= SMALLEST_BATCH:
            try:
                for batch in BatchedWalk(NodeKinds(), self._places, self._content).finished(first):
                    self._shapes.append(_shape(batch))
                    for i in batch.items:
                        del left[i]
            except ModelError:  # something that arrays do not know: an external function
                self._shapes.clear()
                return list(range(len(self._expressions)))
        return list(left)

    def _places(self, leaves: Sequence[Any]) -> list[int]:
        """Places of variables among all leaves; those of parameters are counted down from -1."""
        place_of, every = self._place_of, self._leaves
        places = list(map(place_of.get, map(id, leaves)))
        if None in places:
            for key, leaf in {id(leaf): leaf for leaf in leaves if id(leaf) not in place_of}.items():
                place_of[key] = len(every) if leaf.is_variable_type() else -1 - len(every)
                every.append(leaf)
            places = list(map(place_of.get, map(id, leaves)))
        return cast("list[int]", places)

    def _content(self, named: Any) -> Any:
        content = named._args_[0]
        if not named.is_named_expression_type():
            raise ModelError(f"'{named}' is a call.")
        self._names.append((named, content))
        return content


class RowTerms:
    """The terms that expressions add up, and how large they are: how well a sum can be met depends on them.

    Parameters
    ----------
    expressions : sequence of expressions, variables or numbers
    """

    def __init__(self, expressions: Sequence[Any]) -> None:
        self._names: list[tuple[Any, Any]] = []
        terms = [list(topmost_nodes((expression,), self._is_term)) for expression in expressions]
        self._count = len(terms)
        self._rows = np.repeat(np.arange(self._count), list(map(len, terms)))
        self._values = RowValues([term for several in terms for term in several])

    @property
    def is_current(self) -> bool:
        """Whether named expressions still stand for what they stood for."""
        return all(named._args_[0] is content for named, content in self._names) and self._values.is_current

    def largest(self) -> Array:
        """Magnitude of the largest term of each expression now, numbers apart, and those without a value."""
        sizes = np.zeros(self._count)
        np.fmax.at(sizes, self._rows, np.abs(self._values.values()))
        return sizes

    def _is_term(self, node: Any) -> bool:
        if not node.is_expression_type():
            return True
        if node.is_named_expression_type():
            self._names.append((node, node._args_[0]))
            return False
        return not isinstance(node, (SumExpression, NegationExpression))


class SumValue:
    """Evaluates an expression in which long sums stand, as integrals are; their terms are evaluated as arrays.

    Parameters
    ----------
    expression : expression, variable or number
    """

    def __init__(self, expression: Any) -> None:
        self._expression = expression
        self._names: list[tuple[Any, Any]] = []
        terms: dict[int, Any] = {}
        for total in topmost_nodes((expression,), self._is_long_sum):
            terms.update({id(term): term for term in total.args if term.__class__ not in native_types})
        self._terms = list(terms.values())
        self._values = RowValues(self._terms)

    @property
    def is_current(self) -> bool:
        """Whether named expressions still stand for what they stood for."""
        return all(named._args_[0] is content for named, content in self._names) and self._values.is_current

    def value(self) -> float:
        """Value now; NaN where there is none, or it is no real number."""
        try:
            known = dict(zip(map(id, self._terms), self._values.values().tolist(), strict=True))
            number = NodeValues(known).of(self._expression)
            return math.nan if number is None or isinstance(number, complex) else float(number)
        except (ArithmeticError, ValueError, TypeError):
            return math.nan

    def _is_long_sum(self, node: Any) -> bool:
        if node.is_expression_type() and node.is_named_expression_type():
            self._names.append((node, node._args_[0]))
        return isinstance(node, SumExpression) and node.nargs() >= MANY_TERMS


def _shape(batch: Batch) -> _Shape:
    parameters = {place: np.array(several, dtype=np.intp) for place, several in batch.parameters}
    return _Shape(
        rows=np.array(batch.items, dtype=np.intp),
        code=tuple(batch.code),
        leaves=np.array(batch.columns, dtype=np.intp).reshape(len(batch.columns), len(batch.items)),
        numbers=[None if i in parameters else np.array(row, dtype=float) for i, row in enumerate(batch.numbers)],
        parameters=parameters,
    )
