"""Walks over expressions that meet a node once, however often it occurs.

What a rule computes once and uses many times is one object in Python, and occurs in an expression as often as it is
used, and again as often as that is. The tree of a row can have a hundred times as many nodes as there are objects:
Pyomo's own walks visit the tree.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Set
from typing import Any

from pyomo.core.expr.numvalue import native_types, value

from .rows_by_rule import follows_rule


def variables_in(expression: Any, leaves: Collection[int] = (), include_fixed: bool = True) -> Iterator[Any]:
    """Each variable of an expression once, in the order in which a walk from left to right meets them.

    Parameters
    ----------
    expression : expression, relation, variable or number
    leaves : collection of int
        Ids of named expressions that stand for themselves; they are yielded in place of what they hold.
    include_fixed : bool
    """

    def is_variable(node: Any) -> bool:
        return bool(node.is_variable_type() and (include_fixed or not node.fixed))

    def is_wanted(node: Any) -> bool:
        return follows_rule(node) or not node.is_expression_type() or id(node) in leaves

    for node in topmost_nodes((expression,), is_wanted):
        if follows_rule(node):
            of_sum = {id(each): each for listed in node.repeated().variables for each in listed}
            yield from filter(is_variable, of_sum.values())
        elif node.is_expression_type() or is_variable(node):
            yield node


def topmost_nodes(expressions: Iterable[Any], wanted: Callable[[Any], bool]) -> Iterator[Any]:
    """Nodes that are wanted, each once and from left to right, without those below a node that is wanted.

    Parameters
    ----------
    expressions : iterable of expression, relation, variable or number
    wanted : callable
        ``wanted(node)`` for operators, named expressions, variables and parameters.
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
            pending.extend(reversed(node.args))


def variables_in_any(expressions: Iterable[Any], leaves: Set[int] = frozenset()) -> dict[int, Any]:
    """Each variable that one of many expressions holds, by its id; `leaves` are as in `variables_in`."""
    found = topmost_nodes(expressions, lambda node: not node.is_expression_type() or id(node) in leaves)
    return {id(node): node for node in found if node.is_expression_type() or node.is_variable_type()}


def nodes_of(expression: Any) -> Iterator[Any]:
    """Each node of an expression once: operators, named expressions, variables and parameters, but no numbers."""
    pending = [expression]
    seen: dict[int, Any] = {}
    while pending:
        node = pending.pop()
        if node.__class__ in native_types or id(node) in seen:
            continue
        seen[id(node)] = node
        yield node
        if node.is_expression_type():
            pending.extend(reversed(node.args))


class NodeValues:
    """Values of expressions at what their variables hold now; what they share is evaluated once.

    Errors are those of Pyomo's ``value``: a ValueError where a variable has no value, or what the operation raises. A
    result that is not real is a ValueError, too.

    Parameters
    ----------
    known : mapping of int to float, optional
        Values that are known already, by the ``id`` of the node.
    """

    def __init__(self, known: Mapping[int, float] | None = None) -> None:
        self._known: dict[int, Any] = dict(known or {})
        self._kept: list[Any] = []

    def of(self, expression: Any) -> Any:
        """Value of an expression."""
        if expression.__class__ in native_types:
            return expression
        if not expression.is_expression_type():
            return _value_of_leaf(expression)
        known, kept = self._known, self._kept
        if id(expression) in known:
            return known[id(expression)]
        # Nodes whose arguments are being evaluated, each with the values found so far and the arguments still to come.
        pending: list[tuple[Any, list[Any], Iterator[Any]]] = [(expression, [], iter(expression.args))]
        while True:
            node, numbers, arguments = pending[-1]
            for argument in arguments:
                if argument.__class__ in native_types:
                    numbers.append(argument)
                    continue
                number = known.get(id(argument), known)
                if number is known:
                    if argument.is_expression_type():
                        pending.append((argument, [], iter(argument.args)))
                        break
                    number = known[id(argument)] = _value_of_leaf(argument)
                    kept.append(argument)
                numbers.append(number)
            else:
                pending.pop()
                kept.append(node)
                number = known[id(node)] = node._apply_operation(numbers)
                if number.__class__ is complex:
                    raise ValueError(f"'{node}' is a power of a negative number, {numbers[0]:g}, and no real number")
                if not pending:
                    return number
                pending[-1][1].append(number)


def _value_of_leaf(leaf: Any) -> Any:
    """Of a variable or a parameter; without a value an error, but none in the log: callers try values, and say so."""
    number = value(leaf, exception=False)
    if number is None:
        raise ValueError(f"No value for uninitialized {leaf.__class__.__name__} object {leaf.name}")
    return number


def shared_value(expression: Any, exception: bool = True) -> Any:
    """Value of an expression as Pyomo's ``value`` gives it, with each node evaluated once.

    Parameters
    ----------
    expression : expression, relation, variable, parameter or number
    exception : bool
        Whether an error is raised where a variable has no value; otherwise None is returned.
    """
    if expression.__class__ in native_types or not expression.is_expression_type():
        return value(expression, exception=exception)
    try:
        return NodeValues().of(expression)
    except (ValueError, TypeError):
        if exception:
            raise
        return None


class NodeReplacement:
    """Puts other expressions in place of some nodes; what was one node stays one, among all expressions given.

    Named expressions are replaced by what they hold. Expressions in which nothing is replaced stay as they are.

    Parameters
    ----------
    substitution : mapping of int to Any
        From the ``id`` of a node to what stands in its place.
    """

    def __init__(self, substitution: Mapping[int, Any]) -> None:
        self._known: dict[int, Any] = dict(substitution)
        self._kept: list[Any] = []

    def put(self, node: Any, replacement: Any) -> None:
        """Replace a further node; no expression that was given before may hold it."""
        self._kept.append(node)
        self._known[id(node)] = replacement

    def of(self, expression: Any) -> Any:
        """The expression with the replacements."""
        known = self._known
        pending = [expression]
        while pending:
            node = pending[-1]
            if node.__class__ in native_types or id(node) in known:
                pending.pop()
                continue
            arguments = node.args if node.is_expression_type() else ()
            unknown = [a for a in arguments if a.__class__ not in native_types and id(a) not in known]
            self._kept.append(arguments)  # nodes are known by their ids: they have to live on
            if unknown:
                pending += reversed(unknown)
                continue
            pending.pop()
            self._kept.append(node)
            known[id(node)] = self._made(node, [self._found(a) for a in arguments]) if arguments else node
        return self._found(expression)

    def _found(self, node: Any) -> Any:
        return node if node.__class__ in native_types else self._known[id(node)]

    def _made(self, node: Any, arguments: list[Any]) -> Any:
        """A node with other arguments."""
        if node.is_named_expression_type():
            return arguments[0]
        if all(new is old for new, old in zip(arguments, node.args, strict=True)):
            return node
        if all(argument.__class__ in native_types for argument in arguments):
            return node._apply_operation(arguments)
        return node.create_node_with_local_data(arguments)
