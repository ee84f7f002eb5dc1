"""Nodes that rows share, under names in another model, so that each of them is compiled once.

A ``.nl`` file holds expressions as trees. What a rule computes once and uses many times is written out as often as it
occurs, unless it is a *defined variable*, which Pyomo's writer makes of a named expression. CasADi keeps these. Not
every ASL differentiates them rightly, and the one that build-asl installs writes them out. For ASL a node is the output
of the identity, called like any other function in Python (`compositions`), which has derivatives of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from pyomo.core.base.block import BlockData
from pyomo.core.base.constraint import Constraint, ConstraintData
from pyomo.core.base.expression import Expression
from pyomo.core.base.objective import Objective, ObjectiveData
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.set import Any as AnySet
from pyomo.core.expr.numvalue import native_types

from pyrobocop_pyomo.modeling.bulk_parts import new_row
from pyrobocop_pyomo.modeling.functions import Function
from pyrobocop_pyomo.modeling.shared_nodes import NodeReplacement

# A tree with fewer nodes is written out as quickly as a name for it.
SMALLEST_NAMED = 6
# Other models are written as they are: it takes less time than to look for names.
LEAST_EXCESS = 4_000

IDENTITY = Function(
    lambda X: X[:, 0],
    lambda X: np.ones_like(X),
    lambda X: np.zeros((X.shape[0], 1, 1)),
    inputs=1,
    name="shared",
    check_derivatives=False,
)


class SharedNodes:
    """How often the nodes of some expressions are used, and how many nodes their trees have.

    Parameters
    ----------
    expressions : iterable

    Attributes
    ----------
    trees, nodes : int
        Nodes of all trees together, and different ones.
    """

    def __init__(self, expressions: Iterable[Any]) -> None:
        self._uses: dict[int, int] = {}
        self._sizes: dict[int, int] = {}
        self._kept: list[Any] = []
        self.trees = sum(map(self._add, expressions))

    @property
    def nodes(self) -> int:
        """Different nodes."""
        return len(self._sizes)

    @property
    def worth_naming(self) -> bool:
        """Whether the trees are so much larger that names save time."""
        return self.trees - self.nodes >= LEAST_EXCESS and self.trees >= 2 * self.nodes

    def is_named(self, node: Any) -> bool:
        """Whether a node is large, and used more than once."""
        return self._uses.get(id(node), 0) > 1 and self._sizes[id(node)] >= SMALLEST_NAMED

    def _add(self, expression: Any) -> int:
        if expression.__class__ in native_types:
            return 1
        self._uses[id(expression)] = self._uses.get(id(expression), 0) + 1
        pending = [expression]
        sizes = self._sizes
        while pending:
            node = pending[-1]
            if id(node) in sizes:
                pending.pop()
                continue
            arguments = node.args if node.is_expression_type() else ()
            self._kept.append(arguments)
            inner = [argument for argument in arguments if argument.__class__ not in native_types]
            unknown = [argument for argument in inner if id(argument) not in sizes]
            if unknown:
                pending += unknown
                continue
            pending.pop()
            self._kept.append(node)
            for argument in inner:
                self._uses[id(argument)] = self._uses.get(id(argument), 0) + 1
            sizes[id(node)] = 1 + len(arguments) - len(inner) + sum(sizes[id(argument)] for argument in inner)
        return sizes[id(expression)]


class _Naming(NodeReplacement):
    """Gives names to the shared nodes of some expressions.

    Parameters
    ----------
    shared : SharedNodes
    named : callable
        From a node to what stands for it.
    """

    def __init__(self, shared: SharedNodes, named: Callable[[Any], Any]) -> None:
        super().__init__({})
        self._shared, self._named = shared, named

    def _made(self, node: Any, arguments: list[Any]) -> Any:
        made = super()._made(node, arguments)
        worth = self._shared.is_named(node) and made.__class__ not in native_types
        return self._named(made) if worth and made.is_numeric_type() and made.is_potentially_variable() else made


class NamedModel(NamedTuple):
    """A model in which shared nodes have names.

    Attributes
    ----------
    model : ConcreteModel
    row_of : mapping of int to ConstraintData
        From the ids of its rows to those of the model that it was made from.
    objective : ObjectiveData or None
    """

    model: ConcreteModel
    row_of: Mapping[int, ConstraintData]
    objective: ObjectiveData | None


def with_named_nodes(model: BlockData, objective: ObjectiveData | None, *, by_calls: bool = False) -> NamedModel | None:
    """The active rows and the objective of a model in another one, in which shared nodes have names.

    Parameters
    ----------
    model : Block
    objective : ObjectiveData, optional
        The active one.
    by_calls : bool
        Whether a name is a call of the identity; otherwise it is a named expression.

    Returns
    -------
    NamedModel or None
        None where little is shared.
    """
    rows: list[ConstraintData] = []
    bounded = []
    for row in model.component_data_objects(Constraint, active=True, descend_into=True):
        parts = row.to_bounded_expression()
        if parts[0] is not None or parts[2] is not None:
            rows.append(row)
            bounded.append(parts)
    shared = SharedNodes([*(body for _, body, _ in bounded), *([] if objective is None else [objective.expr])])
    if not shared.worth_naming:
        return None
    other = ConcreteModel(name=model.name)
    other.names, other.rows = Expression(AnySet), Constraint(AnySet)
    naming = _Naming(shared, IDENTITY if by_calls else lambda node: other.names.add(len(other.names), node))
    row_of: dict[int, ConstraintData] = {}
    for row, (lower, body, upper) in zip(rows, bounded, strict=True):
        named = naming.of(body)
        expression = row.expr
        if named is not body:
            expression = named == lower if row.equality else (lower, named, upper)
        row_of[id(new_row(other.rows, len(row_of), expression))] = row
    if objective is None:
        return NamedModel(other, row_of, None)
    other.objective = Objective(expr=naming.of(objective.expr), sense=objective.sense)
    return NamedModel(other, row_of, other.objective)
