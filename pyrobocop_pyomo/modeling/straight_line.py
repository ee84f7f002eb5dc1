"""Expressions as one Python function without nodes: for thousands of evaluations, one after the other.

A walk over an expression takes a microsecond for each node; a line of Python takes a twentieth of that.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pyomo.core.expr.numvalue import native_types, value

from .expression_nodes import (
    CALL,
    CHOICE,
    DIVISION,
    FLOAT_FUNCTIONS,
    FUNCTION,
    LEAF,
    NAMED,
    NEGATION,
    POWER,
    PRODUCT,
    RELATION,
    SUMMATION,
    UNKNOWN,
    comparison_name,
    kind_of_node,
)
from .functions import is_function_call

_SIGNS = {PRODUCT: " * ", DIVISION: " / ", POWER: " ** ", SUMMATION: " + "}


class StraightLine:
    """A function of some variables that gives the values of several expressions; shared nodes are evaluated once.

    Parameters
    ----------
    expressions : sequence of expressions and numbers
    inputs : sequence of VarData
        The arguments of the function, in order.
    functions : mapping of str to callable
        What functions and relations mean for those arguments; see `expression_nodes`.

    Attributes
    ----------
    others : list
        Further variables and parameters that the expressions hold; `refresh` reads their values.

    Raises
    ------
    ValueError
        For an expression with an operator that is not among the kinds of `expression_nodes`.
    """

    def __init__(
        self,
        expressions: Sequence[Any],
        inputs: Sequence[Any],
        functions: Mapping[str, Callable[..., Any]] = FLOAT_FUNCTIONS,
    ) -> None:
        self.others: list[Any] = []
        self._held: list[Any] = []  # values of the others
        self._functions = functions
        self._names = {id(variable): f"x{i}" for i, variable in enumerate(inputs)}
        self._known: dict[str, Any] = {"held": self._held}
        self._kept: list[Any] = []
        self._lines: list[str] = []
        results = [self._name_of(expression) for expression in expressions]
        head = f"def evaluate({', '.join(f'x{i}' for i in range(len(inputs)))}):"
        source = "\n    ".join([head, *self._lines, f"return [{', '.join(results)}]"])
        exec(compile(source, "<expressions>", "exec"), self._known)  # the source is made of the names below alone
        self._evaluate: Callable[..., list[Any]] = self._known["evaluate"]

    def refresh(self) -> None:
        """Read the values of what is no input again.

        Raises
        ------
        ValueError
            Where one has none.
        """
        self._held[:] = [float(value(other)) for other in self.others]

    def __call__(self, *arguments: Any) -> list[Any]:
        """Values of the expressions, in their order."""
        return self._evaluate(*arguments)

    def _name_of(self, expression: Any) -> str:
        """Name or number of the value of an expression, whose lines are written down."""
        pending = [expression]
        while pending:
            node = pending[-1]
            if node.__class__ in native_types or id(node) in self._names:
                pending.pop()
                continue
            leaf = self._is_leaf(node)
            arguments = () if leaf else node.args
            self._kept.append(arguments)  # nodes are known by their ids: they have to live on
            unknown = [a for a in arguments if a.__class__ not in native_types and id(a) not in self._names]
            if unknown:
                pending += reversed(unknown)
                continue
            pending.pop()
            self._kept.append(node)
            self._names[id(node)] = (
                self._other(node) if leaf else self._line(node, list(map(self._known_name, arguments)))
            )
        return self._known_name(expression)

    def _is_leaf(self, node: Any) -> bool:
        return kind_of_node(node.__class__) == LEAF

    def _known_name(self, node: Any) -> str:
        return self._number(node) if node.__class__ in native_types else self._names[id(node)]

    def _number(self, given: Any) -> str:
        number = float(given)
        return repr(number) if math.isfinite(number) else self._constant(number)

    def _other(self, leaf: Any) -> str:
        self.others.append(leaf)
        return f"held[{len(self.others) - 1}]"

    def _line(self, node: Any, given: Sequence[str]) -> str:
        """Name of the value of an operator, whose line is written down."""
        kind = kind_of_node(node.__class__)
        if kind == NAMED:
            return given[0]
        if kind in _SIGNS:
            formula = _SIGNS[kind].join(f"({name})" if name.startswith("-") else name for name in given) or "0.0"
        elif kind == NEGATION:
            formula = f"-({given[0]})"
        elif kind in (FUNCTION, RELATION, CHOICE):
            name = node.getname() if kind == FUNCTION else "choose" if kind == CHOICE else comparison_name(node)
            formula = f"{self._constant(self._functions[name])}({', '.join(given)})"
        elif kind == CALL and is_function_call(node):
            call = self._constant(self._functions["call"])
            formula = f"{call}({', '.join([self._constant(node._fcn), *given])})"
        else:
            assert kind in (CALL, UNKNOWN)
            raise ValueError(f"'{node}' is a {type(node).__name__}, which has no line of Python.")
        name = f"v{len(self._lines)}"
        self._lines.append(f"{name} = {formula}")
        return name

    def _constant(self, held: Any) -> str:
        """Name of a function or of another object in the lines."""
        name = f"c{id(held)}"
        self._known[name] = held  # which also keeps its id
        return name
