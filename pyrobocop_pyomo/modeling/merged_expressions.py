"""Many expressions of the same variables, evaluated together: those that differ in their numbers only are one.

A rule, evaluated at one time after the other, says the same with other numbers, or one of a few things. Each of these
is walked once, with arrays of the numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyomo.core.expr.numvalue import native_numeric_types, value

from .expression_nodes import (
    CALL,
    CHOICE,
    FUNCTION,
    LEAF,
    NAMED,
    RELATION,
    UNKNOWN,
    apply_operator,
    comparison_name,
    kind_of_node,
)
from .functions import is_function_call

FloatArray = NDArray[np.float64]

# A step is a number, a variable, or an operator with the places of its arguments among the steps before.
_NUMBER, _VARIABLE = -1, -2


class MergedExpressions:
    """Values of expressions at a sequence of points, which has its own expressions at each of them.

    Parameters
    ----------
    expressions : sequence of sequences of expressions and numbers
        For each point, always as many.
    variables : sequence of VarData
        What stands in arrays; other leaves count with the values that they have now.

    Raises
    ------
    ValueError
        For a node that has no value, or that nothing is known of.
    """

    def __init__(self, expressions: Sequence[Sequence[Any]], variables: Sequence[Any]) -> None:
        self._shape = (len(expressions), len(expressions[0]))
        places = {id(variable): i for i, variable in enumerate(variables)}
        found: dict[tuple[Any, ...], tuple[list[int], list[list[float]]]] = {}
        for i, entries in enumerate(expressions):
            walk = _Walk(places)
            ends = tuple(walk.of(entry) for entry in entries)
            members, numbers = found.setdefault((ends, tuple(walk.steps)), ([], []))
            members.append(i)
            numbers.append(walk.numbers)
        self._groups = [(*key, members, np.array(numbers, dtype=float)) for key, (members, numbers) in found.items()]

    def __call__(self, columns: Sequence[FloatArray], functions: Mapping[str, Callable[..., Any]]) -> FloatArray:
        """Values, shape (points, entries).

        Parameters
        ----------
        columns : sequence of arrays, shape (points,)
            Values of the variables.
        functions : mapping of str to callable
            As of `ExpressionEvaluator`.
        """
        result = np.empty(self._shape)
        for ends, steps, members, numbers in self._groups:
            values: list[Any] = []
            for kind, what, arguments in steps:
                if kind == _NUMBER:
                    values.append(numbers[:, what])
                elif kind == _VARIABLE:
                    values.append(columns[what][members])
                else:
                    given = [values[place] for place in arguments]
                    if kind == CALL:
                        values.append(functions["call"](what, *given))
                    elif what is not None:
                        values.append(functions[what](*given))
                    else:
                        values.append(apply_operator(kind, given, functions))
            for entry, end in enumerate(ends):
                result[members, entry] = values[end]
        return result


class _Walk:
    """The steps of the expressions at one point; what occurs twice is one step."""

    def __init__(self, places: Mapping[int, int]) -> None:
        self._places = places
        self._known: dict[int, int] = {}
        self._seen: list[Any] = []  # a temporary node has to live on to keep its id
        self.steps: list[tuple[int, Any, tuple[int, ...]]] = []
        self.numbers: list[float] = []

    def of(self, node: Any) -> int:
        """Place of the step that has the value of a node."""
        if node.__class__ in native_numeric_types:
            return self._number(node)
        if id(node) not in self._known:
            self._seen.append(node)
            self._known[id(node)] = self._step(node)
        return self._known[id(node)]

    def _step(self, node: Any) -> int:
        kind = kind_of_node(node.__class__)
        if kind == UNKNOWN or (kind == CALL and not is_function_call(node)):
            raise ValueError(f"'{node}' is a {type(node).__name__}.")
        if kind == NAMED:
            return self.of(node.arg(0))
        if id(node) in self._places:
            return self._append(_VARIABLE, self._places[id(node)])
        if kind == LEAF:
            return self._number(value(node))
        arguments = tuple(self.of(argument) for argument in node.args)
        what: Any = None
        if kind == FUNCTION:
            what = node.getname()
        elif kind == RELATION:
            what = comparison_name(node)
        elif kind == CALL:
            what = node._fcn
        elif kind == CHOICE:
            what = "choose"
        return self._append(kind, what, arguments)

    def _number(self, number: Any) -> int:
        self.numbers.append(float(number))
        return self._append(_NUMBER, len(self.numbers) - 1)

    def _append(self, kind: int, what: Any, arguments: tuple[int, ...] = ()) -> int:
        self.steps.append((kind, what, arguments))
        return len(self.steps) - 1
