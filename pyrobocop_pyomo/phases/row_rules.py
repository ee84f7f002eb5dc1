"""What the rows of a phase say whose rules read variables alone: the same at every point, but for these."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from functools import cached_property, partial
from typing import Any

from pyomo.core.expr.numvalue import native_numeric_types
from pyomo.core.expr.relational_expr import RelationalExpression

from pyrobocop_pyomo.modeling.expression_arrays import plain_scalar
from pyrobocop_pyomo.modeling.rows_by_rule import RepeatedSum, RowRule
from pyrobocop_pyomo.templates.formula_rows import FormulaRows
from pyrobocop_pyomo.templates.slots import Slot
from pyrobocop_pyomo.transcription import collocation_row, collocation_sums

from .families import equations_by_component
from .horizon import element_width
from .record import PhaseRecord, Statement


class Ode:
    """What an ode gives at the points, evaluated when somebody reads it.

    Parameters
    ----------
    block : PhaseBlock
    statement : Statement
    known : dict of time to mapping of name to expression
        What it has given where it was stated first.
    """

    def __init__(self, block: Any, statement: Statement, known: dict[float, dict[str, Any]]) -> None:
        self.block, self.statement, self._known = block, statement, known
        self.label = statement.label(block)

    def at(self, time: float) -> dict[str, Any]:
        """Right-hand sides by the names of the states."""
        if time not in self._known:
            self._known[time] = self._by_state(self.statement(self.block, time))
        return self._known[time]

    @cached_property
    def slots(self) -> dict[Hashable, list[Slot]]:
        """What each right-hand side reads, where the rule reads variables alone."""
        formulas: Any = self.statement.rule.formulas(self.block)
        found: dict[Hashable, list[Slot]] = formulas.slots_by(self._by_state)
        return found

    def _by_state(self, result: Mapping[Any, Any]) -> dict[str, Any]:
        """A result by the names that the states had when it was stated: they may have others by now."""
        given = equations_by_component(self.block.record, result, self.label).values()
        entries = [plain_scalar(entry, self.label) for entry in given]
        return dict(zip(next(iter(self._known.values())), entries, strict=True))


class Rates(Mapping[float, Any]):
    """The right-hand side of one state at the points that its phase has, also on another mesh.

    Parameters
    ----------
    ode : Ode
    name : str
        Of the state when it was stated: it may have another by now.
    """

    def __init__(self, ode: Ode, name: str) -> None:
        self._ode, self._state = ode, name

    def __getitem__(self, time: float) -> Any:
        if time not in self._ode.block.record.grid.element_of:
            raise KeyError(time)
        return self._ode.at(time)[self._state]

    @property
    def slots(self) -> list[Slot]:
        """What it reads, where the rule reads variables alone."""
        return self._ode.slots[self._state]

    def __iter__(self) -> Iterator[float]:
        return iter(self._ode.block.record.grid.points)

    def __len__(self) -> int:
        return len(self._ode.block.record.grid.points)


class CollocationRows(RowRule):
    """The rows that make a state follow its right-hand side.

    Parameters
    ----------
    state : Var
    rates : mapping of collocation point to expression
        `Rates`, where the rows are read later.
    duration, boundary : Var, float or None
        The components of the horizon, which a transformation may rename.
    """

    def __init__(self, state: Any, rates: Any, duration: Any, boundary: Any) -> None:
        self._state, self._rates, self._duration, self._boundary = state, rates, duration, boundary

    def __call__(self, block: Any, index: float) -> Any:
        """The row at a collocation point."""
        element, row = block.record.grid.row_places[index]
        width = element_width(block.record, element, self._duration, self._boundary)
        return collocation_row(self._state, self._rates, block.record.grid, element, row, width)

    def sums(self, block: Any, indices: list[float]) -> list[RepeatedSum]:
        """The state's values, by rows of the scheme, and the right-hand sides."""
        grid = block.record.grid
        # Numbers are factors of the whole, so that elements of different widths repeat one sum.
        widths = [1.0] * grid.mesh.elements if block.record.free_widths else grid.mesh.widths.tolist()
        return collocation_sums(
            grid, dict(self._state.items()), indices, partial(self._right_hand_sides, block), widths
        )

    def _right_hand_sides(self, block: Any, times: list[float], elements: list[int]) -> Any:
        """What the right-hand sides read at some times, factors of their elements included, and each of them."""
        record: PhaseRecord = block.record
        duration, boundary = self._duration, self._boundary
        variables = [slot.at_all(block, times) for slot in self._rates.slots]
        factors = [] if duration.__class__ in native_numeric_types else [[duration] * len(times)]
        if record.free_widths:
            factors += [[boundary[element + end] for element in elements] for end in (0, 1)]
        variables += [each for each in factors if not any(each[0] is known[0] for known in variables)]

        def expression(place: int) -> Any:
            rate = self._rates[times[place]]
            if record.free_widths:
                return element_width(record, elements[place], duration, boundary) * rate
            return duration * rate if record.normalised else rate

        return variables, expression


class StatedRows(FormulaRows):
    """The rows that a rule over the points says.

    Parameters
    ----------
    statement : Statement
    rows : mapping of label to row
        At one point.
    """

    def __init__(self, statement: Statement, rows: Mapping[Hashable, Any]) -> None:
        super().__init__(rows)
        self._statement, self._is_labelled = statement, None not in rows
        self._last: tuple[float, dict[Hashable, Any]] | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_last": None}

    def __call__(self, block: Any, index: Any) -> Any:
        """The row of a time, and of a label where there are several."""
        time, label = self.parts(index)
        if self._last is None or self._last[0] != time:
            self._last = time, self._statement.rows(self._statement(block, time))
        row = self._last[1][label]
        return row if isinstance(row, (RelationalExpression, tuple)) else row == 0

    def parts(self, index: Any) -> tuple[float, Hashable]:
        """The index itself, where rows have labels."""
        return index if self._is_labelled else (index, None)

    def slots(self, block: Any) -> Mapping[Hashable, list[Slot]]:
        """By what the rule says for all times."""
        formulas: Any = self._statement.rule.formulas(block)
        found: dict[Hashable, list[Slot]] = formulas.slots_by(self._statement.rows)
        return found
