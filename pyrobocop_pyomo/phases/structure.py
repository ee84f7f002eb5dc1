"""The structural index of a phase: can the equations of one instant determine its derivatives and algebraics?

At a collocation point the equations are rows and the unknowns are columns: derivatives that are variables of their
own, and algebraics. States, controls and parameters are given there. A derivative that an ode has given is determined
by that ode alone, so neither appears. Where every row and every column can be matched, the index is at most one as
far as the structure goes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.expr.visitor import identify_variables
from pyomo.mpec import Complementarity as PyomoComplementarity

from pyrobocop_pyomo.complementarity import Complementarity
from pyrobocop_pyomo.errors import TranscriptionError
from pyrobocop_pyomo.numerics import Matching, maximum_matching

from .declarations import Algebraic, Control
from .record import PhaseRecord


class PointStructure:
    """Equations and unknowns of one collocation point of a built phase.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
    time : float
        A collocation point.

    Attributes
    ----------
    rows : dict of name to constraint data
        Equations that have to determine something: residuals, and odes of states whose derivative is kept.
    unknowns : dict of name to variable data
        Kept derivatives and algebraics.
    choices : dict of name to variable data
        Controls with a value of their own at this point.
    """

    def __init__(self, block: Any, record: PhaseRecord, time: float) -> None:
        self._block, self._record = block, record
        self.time = time
        self.rows = _rows(block, record, time)
        kept = [name for name in record.names_of_states if name in record.kept_derivatives]
        self.unknowns = {f"derivative of {name}": block.component(f"{name}_derivative")[time] for name in kept}
        self.unknowns.update((name, block.component(name)[time]) for name in record.names(Algebraic))
        self.choices = {
            name: block.component(name)[time]
            for name, declaration in record.declarations.items()
            if isinstance(declaration, Control) and declaration.parametrization == "collocated"
        }

    @cached_property
    def helpers(self) -> dict[str, tuple[Any, ...]]:
        """What may determine an algebraic, but need not, by name: pairs, and equality constraints of the user's own."""
        found: dict[str, tuple[Any, ...]] = {}
        for ctype in (Complementarity, PyomoComplementarity):
            for component in self._block.component_objects(ctype, descend_into=Block):
                found.update((name, sides_of(data)) for name, data in _at(component, self.time).items())
        # An equality of the user's own may stand anywhere and carry any index: what it holds decides.
        ids = {id(variable) for variable in self.unknowns.values()}
        stated = {each.name for each in self._record.statements} | self._record.generated_rows
        for row in self._block.model().component_data_objects(Constraint, active=True) if ids else ():
            own = row.parent_block() is self._block and row.parent_component().local_name in stated
            if row.equality and not own and any(id(variable) in ids for variable in _variables((row.body,))):
                found[row.name] = (row.body,)
        return found

    @cached_property
    def of_rows(self) -> Matching:
        """The equations against the unknowns."""
        return _match([(row.body,) for row in self.rows.values()], self.unknowns.values())

    @cached_property
    def of_rows_with_choices(self) -> Matching:
        """The equations against the unknowns and the controls."""
        columns = [*self.unknowns.values(), *self.choices.values()]
        return _match([(row.body,) for row in self.rows.values()], columns)

    @cached_property
    def of_everything(self) -> Matching:
        """The equations and their helpers against the unknowns."""
        rows = [(row.body,) for row in self.rows.values()]
        return _match([*rows, *self.helpers.values()], self.unknowns.values())

    @property
    def has_higher_index(self) -> bool:
        """True when an equation has nothing to determine, neither an unknown nor a control."""
        return bool(self.of_rows_with_choices.unmatched_rows)

    @property
    def leftover_rows(self) -> list[str]:
        """Equations that share fewer unknowns than they are."""
        names = list(self.rows)
        return [names[row] for row in self.of_rows.overdetermined[0]]

    @property
    def shared_unknowns(self) -> list[str]:
        """The unknowns that the leftover equations share."""
        names = list(self.unknowns)
        return [names[column] for column in self.of_rows.overdetermined[1]]

    @property
    def undetermined(self) -> list[str]:
        """Unknowns that no equation and no helper is left for."""
        names = list(self.unknowns)
        return [names[column] for column in self.of_everything.underdetermined[1]]


def check_structure(block: Any, record: PhaseRecord) -> None:
    """Refuse equations that cannot determine derivatives and algebraics, unless the phase allows it.

    Raises
    ------
    TranscriptionError
        Naming the equations that are left over and the unknowns that nothing determines.
    """
    if record.allow_higher_index:
        return
    structure = PointStructure(block, record, middle_point(record))
    if structure.has_higher_index:
        raise TranscriptionError(f"phase '{block.name}': {describe_higher_index(structure)} {HIGHER_INDEX_REMEDY}")


HIGHER_INDEX_REMEDY = (
    "Differentiate the equation until the unknown appears in it, or state as a 'constraint' what only restricts the "
    "motion. If a higher index is meant, say PhaseBlock(..., allow_higher_index=True)."
)


def describe_higher_index(structure: PointStructure) -> str:
    """Which equations are left over, and which unknowns are short, in words."""
    rows, shared, short = structure.leftover_rows, structure.shared_unknowns, structure.undetermined
    if not shared:
        over = f"{_list('equation', rows)} {_verb(rows, 'holds', 'hold')} no derivative and no algebraic to determine"
    else:
        over = f"{_list('equation', rows)} share only {_list('unknown', shared)}"
    under = f", while nothing determines {_list('unknown', short)}" if short else ""
    return f"the index is higher than 1 at t = {structure.time:g}: {over}{under}."


def _list(noun: str, names: list[str]) -> str:
    return f"{noun}{'s' if len(names) > 1 else ''} {', '.join(map(repr, names))}"


def _verb(names: list[str], one: str, many: str) -> str:
    return one if len(names) == 1 else many


def middle_point(record: PhaseRecord) -> float:
    """A collocation point away from both ends, where nothing is special."""
    points = record.grid.points
    return points[len(points) // 2]


def _rows(block: Any, record: PhaseRecord, time: float) -> dict[str, Any]:
    rows: dict[str, Any] = {}
    for name in record.names_of_states:
        if f"{name}_equation" in record.generated_rows:
            rows[f"ode of {name}"] = block.component(f"{name}_equation")[time]
    for statement in record.statements:
        if statement.kind == "residual":
            rows.update(_at(block.component(statement.name), time))
    return rows


def _at(component: Any, time: float) -> dict[str, Any]:
    """The data of a component at one time by readable name, the time left out."""
    name = component.local_name
    if not component.is_indexed():
        return {}
    if time in component:
        return {name: component[time]}
    found = ((index[1:], data) for index, data in component.items() if isinstance(index, tuple) and index[0] == time)
    return {f"{name}[{','.join(map(str, labels))}]": data for labels, data in found}


def sides_of(pair: Any) -> tuple[Any, ...]:
    """Both sides of a pair of this package or of `pyomo.mpec`, as stated."""
    return tuple(pair.args if pair.ctype is Complementarity else (pair._args or ()))


def _variables(expressions: Iterable[Any]) -> Iterator[Any]:
    for expression in expressions:
        if hasattr(expression, "is_expression_type"):
            yield from identify_variables(expression, include_fixed=True)


def _match(rows: list[tuple[Any, ...]], columns: Iterable[Any]) -> Matching:
    number = {id(variable): i for i, variable in enumerate(columns)}
    incidence = [sorted({number[id(v)] for v in _variables(row) if id(v) in number}) for row in rows]
    return maximum_matching(incidence, len(number))
