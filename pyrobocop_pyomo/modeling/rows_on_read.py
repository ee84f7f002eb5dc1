"""Rows and sums that are made when somebody reads them: until then they are what the rule of their component says.

A row that nobody has read costs less than a tenth of one that is stated, and readers of many rows, such as a program
that is compiled, ask the rule for all of them at once: the same sum, over and over, in other variables.
"""

from __future__ import annotations

import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

from pyomo.core.base.constraint import ConstraintData, TemplateDataMixin
from pyomo.core.base.expression import ExpressionData
from pyomo.core.expr.numvalue import value

from .bulk_parts import put_part


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


class RowOnRead(TemplateDataMixin, ConstraintData):
    """A row that becomes an ordinary one when its expression is read or set."""

    __slots__ = ()

    def to_bounded_expression(self, evaluate_bounds: bool = False) -> tuple[Any, Any, Any]:
        """As of an ordinary row, which this is from now on."""
        self.expr  # noqa: B018 - reading makes it an ordinary one
        return self.to_bounded_expression(evaluate_bounds)


def state_on_read(component: Any, rule: RowRule, indices: Iterable[Any]) -> None:
    """Put rows into a component, which follow a rule."""
    follow_rule(component, rule)
    reference = weakref.ref(component)
    for index in indices:
        row = RowOnRead.__new__(RowOnRead)
        row._component, row._active, row._expr = reference, True, None
        put_part(component, index, row)


def follow_rule(component: Any, rule: Any) -> None:
    """Let a component make its parts by a rule, those that are left unread."""
    component._rule = rule


class UnreadRows(NamedTuple):
    """Active rows of a component that nobody has read.

    Attributes
    ----------
    block : Block
    rule : RowRule
    indices : list
    rows : list of ConstraintData
    """

    block: Any
    rule: RowRule
    indices: list[Any]
    rows: list[ConstraintData]

    def sums(self) -> list[RepeatedSum]:
        """What their bodies are the sums of."""
        return self.rule.sums(self.block, self.indices)

    def bounds(self) -> list[tuple[Any, Any]]:
        """What their bodies may be."""
        return list(map(self.rule.bounds, self.indices))


def unread_rows(component: Any) -> UnreadRows | None:
    """The rows of a component that nobody has read; None where there is none."""
    rule = _rule_of(component)
    if not isinstance(rule, RowRule):
        return None
    rows = {index: row for index, row in component.items() if row.__class__ is RowOnRead and row.active}
    return UnreadRows(component.parent_block(), rule, list(rows), list(rows.values())) if rows else None


def _rule_of(component: Any) -> Any:
    """What Pyomo makes parts of a component by; it has no public question for it."""
    return getattr(component, "_rule", None)


def bounds_of(row: ConstraintData) -> tuple[float | None, float | None]:
    """Numbers between which the body of a row has to be, without a reading of it."""
    if row.__class__ is not RowOnRead:
        lower, _, upper = row.to_bounded_expression(True)
        return lower, upper
    lower, upper = _rule_of(row.parent_component()).bounds(row.index())
    return value(lower), value(upper)


def is_equality(row: ConstraintData) -> bool:
    """Whether a row says that something is equal, without a reading of it."""
    if row.__class__ is not RowOnRead:
        return bool(row.equality)
    lower, upper = _rule_of(row.parent_component()).bounds(row.index())
    return lower is not None and lower is upper


class SumRule(ABC):
    """What the members of a named expression say."""

    @abstractmethod
    def __call__(self, block: Any, index: Any) -> Any:
        """The sum as an expression."""

    @abstractmethod
    def repeated(self, block: Any, index: Any) -> RepeatedSum:
        """The same as the summands of one row, 0."""


class SumOnRead(ExpressionData):
    """A member of a named expression that becomes an ordinary one when its content is read or set."""

    __slots__ = ()

    @property
    def _args_(self) -> tuple[Any]:
        self.set_value(self.made())
        return self._args_

    @_args_.setter
    def _args_(self, content: tuple[Any]) -> None:
        self.__class__ = ExpressionData
        self._args_ = content

    def __reduce_ex__(self, protocol: Any) -> Any:
        self.expr  # noqa: B018 - a pickle holds an ordinary member
        return self.__reduce_ex__(protocol)

    def made(self) -> Any:
        """Its content, which it does not keep."""
        return _rule_of(self.parent_component())(self.parent_block(), self.index())

    def repeated(self) -> RepeatedSum:
        """Its summands."""
        found: RepeatedSum = _rule_of(self.parent_component()).repeated(self.parent_block(), self.index())
        return found


def leave_unread(member: Any) -> None:
    """Let a member of a named expression be what its component's rule says."""
    member.set_value(None)
    member.__class__ = SumOnRead


def is_unread(part: Any) -> bool:
    """Whether something is a row or a sum that nobody has read."""
    return part.__class__ is RowOnRead or part.__class__ is SumOnRead


def as_read(row: Any) -> Any:
    """An ordinary row, or an objective: of a row that nobody has read a twin, so that it stays unread."""
    if row.__class__ is not RowOnRead:
        return row
    component = row.parent_component()
    return ConstraintData(_rule_of(component)(component.parent_block(), row.index()), component)


def content_of(part: Any) -> Any:
    """The body of a row, or the content of a sum; one that nobody has read stays so."""
    if part.__class__ is SumOnRead:
        return part.made()
    return as_read(part).body if isinstance(part, ConstraintData) else part


def sums_of(parts: Sequence[Any]) -> list[RepeatedSum]:
    """What several of them are the sums of, by their positions; parts that are no such rows or sums are left out."""
    found = []
    of_components: dict[int, list[int]] = {}
    for position, part in enumerate(parts):
        if part.__class__ is RowOnRead:
            of_components.setdefault(id(part.parent_component()), []).append(position)
        elif part.__class__ is SumOnRead:
            repeated = part.repeated()
            found.append(repeated._replace(rows=[position] * len(repeated.rows)))
    for positions in of_components.values():
        component = parts[positions[0]].parent_component()
        indices = [parts[position].index() for position in positions]
        for repeated in _rule_of(component).sums(component.parent_block(), indices):
            found.append(repeated._replace(rows=[positions[row] for row in repeated.rows]))
    return found
