"""Rows that are what the rule of their component says: each is made when somebody reads it.

A row that nobody reads costs less than a tenth of one that is stated, and whoever needs many rows, as a program that is
compiled, asks the rule for all of them at once: the same sum, over and over, in other variables. A row that is set to
something else is an ordinary one from then on.
"""

from __future__ import annotations

import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

from pyomo.core.base.constraint import ConstraintData
from pyomo.core.base.expression import ExpressionData
from pyomo.core.expr.numvalue import value

from .pyomo_internals import put_part


class RepeatedSum(NamedTuple):
    """One summand of several rows: the same expression, each time in other variables.

    Attributes
    ----------
    rows : list of int
        Positions of the rows that it is added to.
    scales : list of float
        What the expression is multiplied by, in each of them.
    variables : list of list
        For each variable or parameter of the expression, those that stand in its place in each of them.
    expression : callable
        From a place in these lists to the expression there.
    """

    rows: list[int]
    scales: list[float]
    variables: list[list[Any]]
    expression: Callable[[int], Any]


class RowRule(ABC):
    """What the rows of one component say."""

    def bounds(self, index: Any) -> tuple[Any, Any]:
        """What the body of a row may be at least and at most: numbers, expressions of parameters, or None."""
        return 0.0, 0.0

    @abstractmethod
    def __call__(self, block: Any, index: Any) -> Any:
        """The row of an index, as a rule of Pyomo returns it."""

    @abstractmethod
    def sums(self, block: Any, indices: list[Any]) -> list[RepeatedSum]:
        """The bodies of the rows of some indices; they are the sums of what is returned."""


class RowByRule(ConstraintData):
    """A row that its component's rule says, made when it is read; an ordinary row when it is set to another one."""

    __slots__ = ()
    _expr: Any

    def made(self) -> ConstraintData:
        """An ordinary row that says the same, which is not kept."""
        component = self.parent_component()
        return ConstraintData(component.rule_of_rows(component.parent_block(), self.index()), component)

    def bounds(self) -> tuple[Any, Any]:
        """What its body may be at least and at most, as the rule says it."""
        found: tuple[Any, Any] = self.parent_component().rule_of_rows.bounds(self.index())
        return found

    @property
    def expr(self) -> Any:
        """The relation."""
        if self._expr is None:
            self._expr = self.made().expr
        return self._expr

    def set_value(self, expr: Any) -> None:
        """Make it an ordinary row."""
        self.__class__ = ConstraintData
        self.set_value(expr)

    def to_bounded_expression(self, evaluate_bounds: bool = False) -> tuple[Any, Any, Any]:
        """As of an ordinary row."""
        self.expr  # noqa: B018 - it is made
        found: tuple[Any, Any, Any] = super().to_bounded_expression(evaluate_bounds)
        return found


class SumByRule(Sequence[Any]):
    """The only argument of a named expression that follows a rule: a sum, made when it is read.

    The expression is an ordinary one when it is set to something else.

    Parameters
    ----------
    rule : RowRule
        Says what stands at the index of the expression.
    part : ExpressionData
    """

    def __init__(self, rule: RowRule, part: ExpressionData) -> None:
        self._rule, self._part = rule, part
        self._sum: Any = None

    def __len__(self) -> int:
        return 1

    def __getitem__(self, place: Any) -> Any:
        if self._sum is None:
            self._sum = self._rule(self._part.parent_block(), self._part.index())
        return (self._sum,)[place]

    @property
    def is_made(self) -> bool:
        """Whether somebody has read it."""
        return self._sum is not None

    def forget(self) -> None:
        """Make it anew when it is read again."""
        self._sum = None

    def repeated(self) -> RepeatedSum:
        """Its summands, of which none is made."""
        (found,) = self._rule.sums(self._part.parent_block(), [self._part.index()])
        return found

    def leaves(self) -> list[Any]:
        """The variables and parameters that it holds."""
        return [leaf for alike in self.repeated().variables for leaf in alike]


def sum_by_rule(node: Any) -> SumByRule | None:
    """What a named expression holds, where it follows a rule."""
    held = getattr(node, "_args_", None)
    return held if held.__class__ is SumByRule else None


def put_arguments(part: ExpressionData, arguments: Any) -> None:
    """Let a named expression stand for what it has stood for before, or for a sum that follows a rule."""
    part._args_ = arguments
    if arguments.__class__ is SumByRule:
        arguments.forget()


def add_rows_by_rule(component: Any, rule: RowRule, indices: Iterable[Any]) -> None:
    """Put rows into a component, which follow a rule."""
    component.rule_of_rows = rule  # no rule in Pyomo's sense, by which a component makes parts that it has not
    reference = weakref.ref(component)
    for index in indices:
        row = RowByRule.__new__(RowByRule)
        row._component, row._active, row._expr = reference, True, None
        put_part(component, index, row)


def bounds_of(row: ConstraintData) -> tuple[float | None, float | None]:
    """Numbers between which the body of a row has to be; a row that follows a rule is not made."""
    if row.__class__ is not RowByRule:
        lower, _, upper = row.to_bounded_expression(True)
        return lower, upper
    lower, upper = row.bounds()
    return value(lower), value(upper)


def is_equality(row: ConstraintData) -> bool:
    """Whether a row says that something is equal; a row that follows a rule is not made."""
    if row.__class__ is not RowByRule:
        return bool(row.equality)
    lower, upper = row.bounds()
    return lower is not None and lower is upper


def as_read(row: Any) -> Any:
    """A row or an objective to be read: of a row that follows a rule a twin, so that nothing is kept."""
    return row.made() if row.__class__ is RowByRule else row


def content_of(part: Any) -> Any:
    """The body of a row, of which nothing is kept where it follows a rule; any other expression is itself."""
    return as_read(part).body if isinstance(part, ConstraintData) else part


def rows_by_component(parts: Sequence[Any]) -> list[list[int]]:
    """Positions of the rows that follow a rule, of each component."""
    found: dict[int, list[int]] = {}
    for position, part in enumerate(parts):
        if part.__class__ is RowByRule:
            found.setdefault(id(part.parent_component()), []).append(position)
    return list(found.values())


def sums_of(parts: Sequence[Any]) -> list[RepeatedSum]:
    """What the rows among them that follow a rule are the sums of, by their positions."""
    found = []
    for positions in rows_by_component(parts):
        component = parts[positions[0]].parent_component()
        indices = [parts[position].index() for position in positions]
        for repeated in component.rule_of_rows.sums(component.parent_block(), indices):
            found.append(repeated._replace(rows=[positions[row] for row in repeated.rows]))
    return found
