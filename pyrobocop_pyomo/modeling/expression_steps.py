"""Expressions as a list of steps: read once from Pyomo's nodes, and evaluated over any kind of number."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

from pyomo.core.expr.numvalue import value

from .expression_nodes import (
    ARITHMETIC,
    CALL,
    CHOICE,
    CONSTANT,
    FLOAT_FUNCTIONS,
    FUNCTION,
    LEAF,
    NAMED,
    RELATION,
    UNKNOWN,
    comparison_name,
    kind_of_node,
)
from .functions import is_function_call
from .pyomo_internals import function_of_call
from .shared_nodes import NodesOnce


def _refused(node: Any, reason: str) -> Exception:
    return ValueError(f"'{node}' {reason}.")


class UnknownFunction(ValueError):
    """A function, a relation or a choice has no meaning for the numbers that an expression is evaluated with."""

    def __init__(self, name: str) -> None:
        is_choice = name == "choose" or not name.isidentifier()
        super().__init__(f"It holds {'a choice (Expr_if)' if is_choice else f'the function {name!r}'}.")


class Leaf:
    """A variable or a parameter that is read; equal to itself alone, where Pyomo would make an equation."""

    __slots__ = ("node",)

    def __init__(self, node: Any) -> None:
        self.node = node

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Leaf) and other.node is self.node

    def __hash__(self) -> int:
        return id(self.node)


class ExpressionStep(NamedTuple):
    """One operation, or what is read.

    Attributes
    ----------
    kind : int
        Of `expression_nodes`.
    what : object
        The number of a constant, the place of a leaf among all leaves, the name of a function, a relation or a choice;
        of a call the `Function`'s output.
    arguments : tuple of int
        Places of the steps that it works on.
    """

    kind: int
    what: Any
    arguments: tuple[int, ...] = ()


class ExpressionSteps:
    """Several expressions as steps; a node that they share is one step.

    Parameters
    ----------
    expressions : sequence of expressions and numbers
    leaf_of : callable
        From a node to what is read in its place, which can be hashed; None for an operation. By default the `Leaf` of a
        variable or a parameter.
    refuse : callable
        From a node and a reason, which continues a sentence about the node, to the exception that is raised.

    Attributes
    ----------
    leaves : list
        What is read, in the order in which it was met.
    steps : list of ExpressionStep
        Each after those that it works on.
    nodes : list
        What each step was read from.
    outputs : list of int
        Places of the expressions.

    Raises
    ------
    Exception
        By `refuse`, for an operator that is not among the kinds of `expression_nodes`.
    """

    def __init__(
        self,
        expressions: Sequence[Any],
        leaf_of: Callable[[Any], Any] | None = None,
        refuse: Callable[[Any, str], Exception] = _refused,
    ) -> None:
        self.leaves: list[Any] = []
        self.steps: list[ExpressionStep] = []
        self.nodes: list[Any] = []
        self._refuse = refuse
        walk = _Walk(self, leaf_of or _variable_or_parameter)
        self.outputs = [walk.place_of(expression) for expression in expressions]

    def __deepcopy__(self, memo: dict[int, Any]) -> ExpressionSteps:
        twin = copy.copy(self)
        twin.leaves, twin.nodes = copy.deepcopy(self.leaves, memo), []
        return twin

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "nodes": []}

    def evaluate(
        self, value_of: Callable[[Any], Any], functions: Mapping[str, Callable[..., Any]] = FLOAT_FUNCTIONS
    ) -> list[Any]:
        """The expressions, in their order.

        Parameters
        ----------
        value_of : callable
            From a leaf to what stands in its place: a number, an array, an expression, bounds.
        functions : mapping of str to callable
            What functions, relations and choices mean for these; see `expression_nodes`. Arithmetic they know.

        Raises
        ------
        UnknownFunction
            For a function that is not among them.
        """
        values = self._constants.copy()
        for place, (kind, what, arguments) in self._needed_steps:
            if kind == LEAF:
                values[place] = value_of(self.leaves[what])
            elif what is None:
                values[place] = ARITHMETIC[kind](*[values[of] for of in arguments])
            elif (function := functions.get("call" if kind == CALL else what)) is None:
                raise UnknownFunction("call" if kind == CALL else what)
            else:
                given = (values[of] for of in arguments)
                values[place] = function(what, *given) if kind == CALL else function(*given)
        return [values[place] for place in self.outputs]

    def part(self, places: Sequence[int]) -> ExpressionSteps:
        """The same steps with others as the results."""
        twin = copy.copy(self)
        twin.outputs = list(places)
        for known in ("needed", "_needed_steps"):
            twin.__dict__.pop(known, None)
        return twin

    def evaluate_at(
        self, leaves: Mapping[int, Any], functions: Mapping[str, Callable[..., Any]] = FLOAT_FUNCTIONS
    ) -> list[Any]:
        """The expressions with some variables replaced, by their identities; others count with their values.

        Raises
        ------
        Exception
            By `refuse`, where a variable has no value, as for `evaluate`.
        """
        return self.evaluate(lambda leaf: self._replaced(leaf, leaves), functions)

    def _replaced(self, leaf: Leaf, leaves: Mapping[int, Any]) -> Any:
        if id(leaf.node) in leaves:
            return leaves[id(leaf.node)]
        number = value(leaf.node, exception=False)
        if number is None:
            raise self._refuse(leaf.node, "has no value")
        return float(number)

    @cached_property
    def _constants(self) -> list[Any]:
        """For each step its number, if it is one."""
        return [step.what if step.kind == CONSTANT else None for step in self.steps]

    @cached_property
    def _needed_steps(self) -> list[tuple[int, ExpressionStep]]:
        steps = ((place, step) for place, step in enumerate(self.steps) if step.kind != CONSTANT)
        return [(place, step) for place, step in steps if self.needed[place]]

    @cached_property
    def needed(self) -> list[bool]:
        """For each step, whether an output depends on it."""
        needed = [False] * len(self.steps)
        for place in self.outputs:
            needed[place] = True
        for place in reversed(range(len(needed))):
            for argument in self.steps[place].arguments if needed[place] else ():
                needed[argument] = True
        return needed

    def depends_on(self, leaves: Callable[[Any], bool]) -> list[bool]:
        """For each step, whether it depends on one of those leaves."""
        found: list[bool] = []
        for step in self.steps:
            own = step.kind == LEAF and leaves(self.leaves[step.what])
            found.append(own or any(found[place] for place in step.arguments))
        return found


class _Walk(NodesOnce):
    """Adds the steps of nodes; what it finds at each is a tuple of its place, which no number is."""

    def __init__(self, steps: ExpressionSteps, leaf_of: Callable[[Any], Any]) -> None:
        super().__init__()
        self._steps, self._leaf_of = steps, leaf_of
        self._places: dict[Any, tuple[int]] = {}  # of leaves and numbers

    def place_of(self, expression: Any) -> int:
        """The place of an expression, whose steps are added."""
        return self._place(self.of(expression))

    def goes_below(self, node: Any) -> bool:
        return self._leaf_of(node) is None

    def of_leaf(self, leaf: Any) -> tuple[int]:
        read = self._leaf_of(leaf)
        if read not in self._places:
            self._places[read] = self._add(leaf, ExpressionStep(LEAF, len(self._steps.leaves)))
            self._steps.leaves.append(read)
        return self._places[read]

    def of_operation(self, node: Any, found: list[Any]) -> tuple[int]:
        kind, places = kind_of_node(node.__class__), tuple(map(self._place, found))
        if kind == NAMED:
            return (places[0],)
        if kind == UNKNOWN or (kind == CALL and not is_function_call(node)):
            raise self._steps._refuse(node, f"is a {type(node).__name__}")
        return self._add(node, ExpressionStep(kind, _what(kind, node), places))

    def _place(self, found: Any) -> int:
        if found.__class__ is tuple:
            return int(found[0])
        key = (found.__class__, found)
        if key not in self._places:
            number = found if found.__class__ is int else float(found)
            self._places[key] = self._add(found, ExpressionStep(CONSTANT, number))
        return self._places[key][0]

    def _add(self, node: Any, step: ExpressionStep) -> tuple[int]:
        self._steps.steps.append(step)
        self._steps.nodes.append(node)
        return (len(self._steps.steps) - 1,)


def _what(kind: int, node: Any) -> Any:
    if kind == FUNCTION:
        return node.getname()
    if kind == RELATION:
        return comparison_name(node)
    if kind == CALL:
        return function_of_call(node)
    return "choose" if kind == CHOICE else None


def _variable_or_parameter(node: Any) -> Leaf | None:
    return Leaf(node) if kind_of_node(node.__class__) == LEAF else None
