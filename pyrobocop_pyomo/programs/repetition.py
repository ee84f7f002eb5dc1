"""Whether a model repeats its nonlinear terms so often that they are better derived once for each shape."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Any

from pyomo.core.base.block import BlockData
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective

from pyrobocop_pyomo.modeling.expression_nodes import (
    CALL,
    CHOICE,
    CONSTANT,
    DIVISION,
    FUNCTION,
    LEAF,
    NAMED,
    POWER,
    PRODUCT,
    SUMMATION,
    UNKNOWN,
    kind_of_node,
)
from pyrobocop_pyomo.modeling.functions import is_function_call

# Deriving one node of a shape takes ten times as long as writing one into a file and reading it there.
REPETITIONS = 8
# So many nodes are enough to see that; all nodes of a large model would take longer to count than they take to derive.
ENOUGH_NODES = 10_000
# Counting itself stops here, within a tenth of a second.
_MOST_NODES = 24 * ENOUGH_NODES
# Of each component, before the other rows: they often are as many repetitions as it takes.
_FIRST_ROWS = 256


def repeats_nonlinear_terms(model: BlockData, *, fewest_nodes: int = 0) -> bool:
    """Whether the active nonlinear rows and the terms of the objective are mostly repetitions of few shapes.

    Named expressions count wherever they are used, as ASL evaluates them. Two terms are repetitions of each other when
    they have the same operators in the same order. In models of more than 240 000 nodes the first so many decide.

    Parameters
    ----------
    model : Block
        Complementarity has to be relaxed before.
    fewest_nodes : int
        Of nonlinear terms: a model with fewer does not count, unless it calls Python functions.

    Returns
    -------
    bool
        True also where a row calls Python functions: these are evaluated at all points at once, and what is vectorised
        needs no file. False where a row calls other external functions, which vectorised expressions do not know, and
        where nothing is nonlinear.
    """
    visited = nodes = different = 0
    shapes: set[bytes] = set()
    for term in _terms_of(model):
        kinds, nonlinear = _kinds_of_nodes(term)
        visited += len(kinds)
        if nonlinear:
            if UNKNOWN in kinds:
                return False
            if CALL in kinds:
                return True
            nodes += len(kinds)
            shape = bytes(kinds)
            if shape not in shapes:
                shapes.add(shape)
                different += len(kinds)
        if nodes >= max(ENOUGH_NODES, fewest_nodes) and nodes >= REPETITIONS * different:
            return True
        if visited >= _MOST_NODES:
            break
    return nodes >= fewest_nodes and 0 < REPETITIONS * different <= nodes


def _terms_of(model: BlockData) -> Iterator[Any]:
    """Bodies of the rows, and the terms of which an objective is the sum; some rows of each component come first."""
    components = model.component_objects(Constraint, active=True, descend_into=True)
    rows = [(row for row in component.values() if row.active) for component in components]
    for some in rows:
        for row in islice(some, _FIRST_ROWS):
            yield row.body
    for others in rows:
        for row in others:
            yield row.body
    for objective in model.component_data_objects(Objective, active=True, descend_into=True):
        pending = [objective.expr]
        while pending:
            node = pending.pop()
            kind = kind_of_node(node.__class__)
            if kind in (SUMMATION, NAMED):
                pending += node._args_[: node._nargs] if kind == SUMMATION else node._args_
            elif kind == PRODUCT and kind_of_node(node._args_[0].__class__) == CONSTANT:
                pending.append(node._args_[1])
            else:
                yield node


def _kinds_of_nodes(expression: Any) -> tuple[list[int], bool]:
    """Kinds in the order of a walk, and whether one of them makes the expression nonlinear."""
    kinds: list[int] = []
    nonlinear = False
    entered: dict[int, Any] = {}  # what occurs again in a row is evaluated once
    pending = [expression]
    while pending:
        node = pending.pop()
        kind = kind_of_node(node.__class__)
        kinds.append(kind)
        if kind in (LEAF, CONSTANT) or id(node) in entered:
            continue
        entered[id(node)] = node
        if kind == UNKNOWN or (kind == CALL and not is_function_call(node)):
            return [UNKNOWN], True
        if kind == CALL:
            return [CALL], True
        arguments = node._args_[: node._nargs] if kind == SUMMATION else node._args_
        if not nonlinear:
            # A number before a product and a number below a fraction are how Pyomo writes linear terms.
            if kind in (POWER, FUNCTION, CHOICE):
                nonlinear = True
            elif kind in (PRODUCT, DIVISION):
                nonlinear = kind_of_node(arguments[kind == DIVISION].__class__) != CONSTANT
        pending += arguments
    return kinds, nonlinear
