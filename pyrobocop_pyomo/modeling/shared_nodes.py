"""Walks over expressions that meet a node once, however often it occurs.

What a rule computes once and uses many times is one object in Python, and occurs in an expression as often as it is
used, and again as often as that is. The tree of a row can have a hundred times as many nodes as there are objects:
Pyomo's own walks visit the tree.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from itertools import chain
from operator import attrgetter
from typing import Any

from pyomo.core.expr.numvalue import native_types, value


def variables_in(expression: Any, include_fixed: bool = True) -> Iterator[Any]:
    """Each variable of an expression once, in the order in which a walk from left to right meets them.

    Parameters
    ----------
    expression : expression, relation, variable or number
    include_fixed : bool
    """
    for leaf in topmost_nodes((expression,), lambda node: not node.is_expression_type(), _leaves_or_arguments):
        if leaf.is_variable_type() and (include_fixed or not leaf.fixed):
            yield leaf


def _leaves_or_arguments(node: Any) -> Sequence[Any]:
    """What is below a node; of a sum that follows a rule, which is not made, all variables and parameters."""
    below: Any = node.args
    arguments: Sequence[Any] = below.leaves() if hasattr(below, "leaves") else below
    return arguments


def topmost_nodes(
    expressions: Iterable[Any],
    wanted: Callable[[Any], bool],
    below: Callable[[Any], Sequence[Any]] = attrgetter("args"),
) -> Iterator[Any]:
    """Nodes that are wanted, each once and from left to right, without those below a node that is wanted.

    Parameters
    ----------
    expressions : iterable of expression, relation, variable or number
    wanted : callable
        ``wanted(node)`` for operators, named expressions, variables and parameters.
    below : callable
        From an operator or a named expression to the nodes below it.
    """
    pending = [*expressions][::-1]
    seen: dict[int, Any] = {}  # nodes that Pyomo makes for the moment have to live on to keep their ids
    while pending:
        node = pending.pop()
        if node.__class__ in native_types or id(node) in seen:
            continue
        seen[id(node)] = node
        if wanted(node):
            yield node
        elif node.is_expression_type():
            pending.extend(reversed(below(node)))


def variables_in_any(expressions: Iterable[Any], leaves: Set[int] = frozenset()) -> dict[int, Any]:
    """Each variable that one of many expressions holds, by its id.

    `leaves` are ids of named expressions that stand for themselves; they are found in place of what they hold.
    """
    is_wanted: Callable[[Any], bool] = lambda node: not node.is_expression_type() or id(node) in leaves  # noqa: E731
    found = topmost_nodes(expressions, is_wanted, _leaves_or_arguments)
    return {id(node): node for node in found if node.is_expression_type() or node.is_variable_type()}


def expressions_returned(result: Any) -> Iterator[Any]:
    """Expressions and relations in whatever a rule returned: also pairs, in lists, tuples and mappings."""
    if isinstance(result, Mapping):
        result = list(result.values())
    if isinstance(result, (list, tuple)):
        for each in result:
            yield from expressions_returned(each)
    elif hasattr(result, "is_expression_type"):
        yield result


def variables_read(result: Any) -> list[Any]:
    """Variables in whatever a rule returned, those of one expression after those of the one before."""
    return list(chain.from_iterable(map(variables_in, expressions_returned(result))))


class NodesOnce(ABC):
    """A walk over expressions that meets a node once: what was found there is known for all that follow.

    Parameters
    ----------
    known : mapping of int to object, optional
        What is known already, by the ``id`` of the node.
    """

    def __init__(self, known: Mapping[int, Any] | None = None) -> None:
        self._known: dict[int, Any] = dict(known or {})
        self._kept: list[Any] = []  # nodes are known by their ids: they have to live on

    def goes_below(self, node: Any) -> bool:
        """Whether the arguments of a node are looked at."""
        return bool(node.is_expression_type())

    @abstractmethod
    def of_leaf(self, leaf: Any) -> Any:
        """What is found at a variable or a parameter."""

    @abstractmethod
    def of_operation(self, node: Any, found: list[Any]) -> Any:
        """What is found at an operator or a named expression, from what was found at its arguments."""

    def of(self, expression: Any) -> Any:
        """What is found at an expression; a number is itself."""
        known, kept = self._known, self._kept
        # Nodes whose arguments are being looked at, each with what was found so far and the arguments still to come.
        pending: list[tuple[Any, list[Any], Iterator[Any]]] = [(None, [], iter([expression]))]
        while True:
            node, found, arguments = pending[-1]
            for argument in arguments:
                if argument.__class__ in native_types:
                    found.append(argument)
                    continue
                here = known.get(id(argument), known)
                if here is known:
                    if self.goes_below(argument):
                        pending.append((argument, [], iter(argument.args)))
                        break
                    here = known[id(argument)] = self.of_leaf(argument)
                    kept.append(argument)
                found.append(here)
            else:
                pending.pop()
                if not pending:
                    return found[0]
                kept.append(node)
                here = known[id(node)] = self.of_operation(node, found)
                pending[-1][1].append(here)


class NodeValues(NodesOnce):
    """Values of expressions at what their variables hold now.

    Errors are those of Pyomo's ``value``: a ValueError where a variable has no value, or what the operation raises. A
    result that is not real is a ValueError, too.
    """

    def of_leaf(self, leaf: Any) -> Any:
        """Its value; without one an error, but none in the log: callers try values, and say so."""
        number = value(leaf, exception=False)
        if number is None:
            raise ValueError(f"No value for uninitialized {leaf.__class__.__name__} object {leaf.name}")
        return number

    def of_operation(self, node: Any, found: list[Any]) -> Any:
        """Its value."""
        number = node._apply_operation(found)
        if number.__class__ is complex:
            raise ValueError(f"'{node}' is a power of a negative number, {found[0]:g}, and no real number")
        return number


def shared_value(expression: Any, exception: bool = True, known: Mapping[int, float] | None = None) -> Any:
    """Value of an expression as Pyomo's ``value`` gives it, with each node evaluated once.

    Parameters
    ----------
    expression : expression, relation, variable, parameter or number
    exception : bool
        Whether an error is raised where a variable has no value; otherwise None is returned.
    known : mapping of int to float, optional
        Values of some nodes, by the ``id`` of the node.
    """
    if expression.__class__ in native_types or not expression.is_expression_type():
        return value(expression, exception=exception)
    try:
        return NodeValues(known).of(expression)
    except (ValueError, TypeError):
        if exception:
            raise
        return None


class NodeReplacement(NodesOnce):
    """Puts other expressions in place of some nodes; what was one node stays one, among all expressions given.

    Named expressions are replaced by what they hold. Expressions in which nothing is replaced stay as they are.
    """

    def of_leaf(self, leaf: Any) -> Any:
        """Itself."""
        return leaf

    def of_operation(self, node: Any, found: list[Any]) -> Any:
        """A node with other arguments."""
        if node.is_named_expression_type():
            return found[0]
        if all(new is old for new, old in zip(found, node.args, strict=True)):
            return node
        if all(argument.__class__ in native_types for argument in found):
            return node._apply_operation(found)
        return node.create_node_with_local_data(found)
