"""Whether a model repeats large nonlinear rows so often that their evaluation takes most of a solve."""

from __future__ import annotations

from typing import Any

from pyomo.core.base.block import BlockData
from pyomo.core.base.constraint import Constraint

from pyrobocop_pyomo.modeling.expression_nodes import (
    CALL,
    CHOICE,
    CONSTANT,
    DIVISION,
    FUNCTION,
    LEAF,
    POWER,
    PRODUCT,
    SUMMATION,
    UNKNOWN,
    kind_of_node,
)
from pyrobocop_pyomo.modeling.functions import is_function_call

# ASL then takes more than a millisecond for the derivatives of one iteration, as long as its linear system takes.
MANY_NODES = 30_000
# A function of each shape is derived once: that is worth its time where it is used several times.
REPETITIONS = 8
# Counting itself stops here, within a tenth of a second.
_MOST_NODES = 8 * MANY_NODES


def repeats_large_rows(model: BlockData) -> bool:
    """Whether the active nonlinear rows have many nodes, and few that are not repetitions of others.

    Named expressions count wherever they are used, as ASL evaluates them. Two rows are repetitions of each other when
    they have the same operators in the same order. In models of more than 240 000 nodes the first so many decide.

    Parameters
    ----------
    model : Block
        Complementarity has to be relaxed before.

    Returns
    -------
    bool
        True also where a row calls Python functions: these are evaluated at all points at once, and what is vectorised
        needs no file. False where a row calls other external functions, which vectorised expressions do not know.
    """
    visited = nodes = different = 0
    shapes: set[bytes] = set()
    for row in model.component_data_objects(Constraint, active=True, descend_into=True):
        kinds, nonlinear = _kinds_of_nodes(row.body)
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
        if nodes >= MANY_NODES and nodes >= REPETITIONS * different:
            return True
        if visited >= _MOST_NODES:
            break
    return False


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
