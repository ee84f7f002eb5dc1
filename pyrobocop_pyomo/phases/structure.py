"""Does a phase make sense? Counts, appearances, and the structural index, checked before any solve.

At a collocation point the equations are rows and the unknowns are columns: derivatives that are variables of their
own, and algebraics. States, controls and parameters are given there. A derivative that an ode has given is determined
by that ode alone, so neither appears. Where every row and every column can be matched, the index is at most one as
far as the structure goes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cached_property
from itertools import islice
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective

from pyrobocop_pyomo.complementarity import Complementarity
from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.rows_by_rule import as_read, content_of, is_equality
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.numerics import Matching

from .declarations import Algebraic, Control, Parameter
from .horizon import refuse_no_duration
from .record import PhaseRecord
from .variables import refuse_weightless_controls


def check_phase(block: Any) -> None:
    """Raise an error that names the culprit when equations and variables do not fit, or no time is left for them."""
    if any(block.component(name) is None for name in block.record.declarations):
        return  # a transformation has renamed the variables, as scaling does: the record is about another model
    if getattr(block.duration, "fixed", False):
        refuse_no_duration(block)
    _check_each_state_has_an_equation(block)
    structure = PointStructure(block, middle_point(block.record))
    _check_counts(block, structure)
    refuse_weightless_controls(block)
    _check_each_variable_appears(block)
    if structure.has_higher_index and not block.record.allow_higher_index:
        raise ModelError(f"phase '{block.name}': {describe_higher_index(structure)} {HIGHER_INDEX_REMEDY}")


def _check_each_state_has_an_equation(block: Any) -> None:
    lost = [
        f"'{name}' (declared at {block.record.declarations[name].declared_at})"
        for name in block.record.names_of_states
        if name not in block.record.equation_of and name not in block.record.kept_derivatives
    ]
    if lost:
        which, have = ("state", "has") if len(lost) == 1 else ("states", "have")
        raise ModelError(
            f"phase '{block.name}': {which} {', '.join(lost)} {have} no equation. State its derivative in "
            "an ode, or use phase.derivative(...) in a residual, or state its next value in a step; what has no "
            "derivative is Algebraic or Control."
        )


def _check_counts(block: Any, structure: PointStructure) -> None:
    record: PhaseRecord = block.record
    surplus = len(structure.rows) - len(structure.unknowns)
    # A pair may determine an algebraic, or just restrict the controls; the user's own equality constraints likewise.
    # They count only when something is missing; all rows are looked through where the pairs are not enough.
    helpers = len(structure.pairs) if surplus < 0 else 0
    if surplus + helpers < 0:
        helpers = _most_helpers(block)
    if surplus <= 0 <= surplus + helpers:
        return
    states, algebraics = len(record.names_of_states), len(record.names(Algebraic))
    counts = (
        f"{counted(states, 'state')} and {counted(algebraics, 'algebraic')} need "
        f"{counted(states + algebraics, 'equation')} per collocation point; stated are {len(record.equation_of)} in "
        f"{'odes and steps' if record.discrete_states else 'odes'}, {record.residuals_per_point} in residuals and "
        f"{counted(helpers, 'pair or equality')} beside"
    )
    if surplus > 0:
        raise ModelError(
            f"phase '{block.name}': too many equations. {counts}. Remove an equation, declare what it determines as "
            "Algebraic, or state it as a 'constraint' that restricts the controls."
        )
    raise ModelError(
        f"phase '{block.name}': too few equations. {counts}. Add an equation, or declare what is free to choose as "
        "Control."
    )


def counted(number: int, noun: str) -> str:
    """A number of things, in words: "1 state", "2 states"."""
    return f"{number} {noun}{'s' * (number != 1)}"


def _check_each_variable_appears(block: Any) -> None:
    """A variable in no row and no objective would come back as noise: name it."""
    declared = [name for kind in (Control, Algebraic, Parameter) for name in block.record.names(kind)]
    missing = {name: {id(data) for data in _variables(block, name)} for name in declared}
    for expression in _expressions(block):
        if not missing:
            return
        seen = {id(variable) for variable in variables_in(expression, include_fixed=True)}
        missing = {name: ids for name, ids in missing.items() if not ids & seen}
    for name in missing:
        declaration = block.record.declarations[name]
        kind = type(declaration).__name__.lower()
        raise ModelError(
            f"phase '{block.name}': {kind} '{name}' (declared at {declaration.declared_at}) appears in no equation, "
            "constraint or objective. Use it or remove it."
        )


def _variables(block: Any, name: str) -> Any:
    if isinstance(block.record.declarations[name], Parameter):
        return [block.component(name)]
    return block.record.nodes(name).variables(block)


def _expressions(block: Any) -> Any:
    # Rows of one point of each of the phase's own components first: nearly always everything is found there.
    # Not component_objects(active=True): that finds nothing in a phase which is itself deactivated.
    own = [component for component in block.component_map(Constraint).values() if component.active]
    points = len(block.record.grid.points)
    for component in own:
        yield from map(content_of, islice(component.values(), -(-len(component) // points)))
    for data in block.component_data_objects(PAIR_TYPES, descend_into=False):
        yield from sides_of(data)
    for component in own:
        yield from map(content_of, component.values())
    for data in block.model().component_data_objects((Constraint, Objective), active=True):
        yield from sides_of(data)


class PointStructure:
    """Equations and unknowns of one collocation point of a built phase.

    Parameters
    ----------
    block : PhaseBlock
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

    def __init__(self, block: Any, time: float) -> None:
        self._block, self.time = block, time
        self.rows = _rows(block, time)
        self._contents = [(content_of(row),) for row in self.rows.values()]
        self.unknowns = _unknowns(block, time)
        controls = ((name, of) for name, of in block.record.declarations.items() if isinstance(of, Control))
        collocated = [name for name, of in controls if of.parametrization == "collocated"]
        self.choices = {name: block.component(name)[time] for name in collocated}

    @property
    def pairs(self) -> dict[str, tuple[Any, ...]]:
        """Both sides of the pairs at this point, by name."""
        found: dict[str, tuple[Any, ...]] = {}
        for component in self._block.component_objects(PAIR_TYPES, descend_into=Block):
            found.update((name, sides_of(data)) for name, data in _at(component, self.time).items())
        return found

    @cached_property
    def helpers(self) -> dict[str, tuple[Any, ...]]:
        """What may determine an algebraic, but need not, by name: pairs, and equality constraints of the user's own."""
        times = {id(variable): self.time for variable in self.unknowns.values()}
        return {**self.pairs, **{row.name: (content_of(row),) for _, row in _own_equalities(self._block, times)}}

    @cached_property
    def of_rows(self) -> Matching:
        """The equations against the unknowns."""
        return self._match(self._contents, self.unknowns)

    @property
    def has_higher_index(self) -> bool:
        """True when an equation has nothing to determine, neither an unknown nor a control."""
        return bool(self._match(self._contents, self.unknowns | self.choices).unmatched_rows)

    @property
    def leftover_rows(self) -> list[str]:
        """Equations that share fewer unknowns than they are."""
        names = list(self.rows)
        return [names[row] for row in self.of_rows.overdetermined[0]]

    @cached_property
    def undetermined(self) -> list[str]:
        """Unknowns that no equation and no helper is left for."""
        return self._match([*self._contents, *self.helpers.values()], self.unknowns).underdetermined[1]

    @staticmethod
    def _match(rows: list[tuple[Any, ...]], unknowns: dict[str, Any]) -> Matching:
        """Rows against the names of unknowns that they hold."""
        name_of = {id(variable): name for name, variable in unknowns.items()}
        held = [[name_of[id(of)] for of in _variables_in(row) if id(of) in name_of] for row in rows]
        return Matching(held, unknowns)


HIGHER_INDEX_REMEDY = (
    "Differentiate the equation until the unknown appears in it, or state as a 'constraint' what only restricts the "
    "motion. If a higher index is meant, say PhaseBlock(..., allow_higher_index=True)."
)


def describe_higher_index(structure: PointStructure) -> str:
    """Which equations are left over, and which unknowns are short, in words."""
    rows, shared, short = structure.leftover_rows, structure.of_rows.overdetermined[1], structure.undetermined
    if not shared:
        hold = "holds" if len(rows) == 1 else "hold"
        over = f"{_list('equation', rows)} {hold} no derivative and no algebraic to determine"
    else:
        over = f"{_list('equation', rows)} share only {_list('unknown', shared)}"
    under = f", while nothing determines {_list('unknown', short)}" if short else ""
    return f"the index is higher than 1 at t = {structure.time:g}: {over}{under}."


def _list(noun: str, names: list[str]) -> str:
    return f"{noun}{'s' if len(names) > 1 else ''} {', '.join(map(repr, names))}"


def middle_point(record: PhaseRecord) -> float:
    """A collocation point away from both ends, where nothing is special."""
    points = record.grid.points
    return points[len(points) // 2]


def _unknowns(block: Any, time: float) -> dict[str, Any]:
    kept = [name for name in block.record.names_of_states if name in block.record.kept_derivatives]
    derivatives = {f"derivative of {name}": block.component(f"{name}_derivative")[time] for name in kept}
    return {**derivatives, **{name: block.component(name)[time] for name in block.record.names(Algebraic)}}


def _own_equalities(block: Any, times: dict[int, float]) -> Iterator[tuple[float, Any]]:
    """Equality constraints of the user's own that hold unknowns, each after the time of these.

    They may stand anywhere and carry any index.

    Parameters
    ----------
    block : PhaseBlock
    times : dict of id to float
        Of each unknown.
    """
    stated = {statement.name for statement in block.record.statements} | block.record.generated_rows
    for row in block.model().component_data_objects(Constraint, active=True) if times else ():
        own = row.parent_block() is block and row.parent_component().local_name in stated
        if not own and is_equality(row):
            held = {times[id(variable)] for variable in _variables_in((content_of(row),)) if id(variable) in times}
            yield from ((time, row) for time in held)


def _most_helpers(block: Any) -> int:
    """How many pairs and equalities the collocation point has that has most of them: a rule may skip some points."""
    points = block.record.grid.points
    times = {id(variable): time for time in points for variable in _unknowns(block, time).values()}
    found = Counter(time for time, _ in _own_equalities(block, times))
    for component in block.component_objects(PAIR_TYPES, descend_into=Block):
        found.update(index[0] if isinstance(index, tuple) else index for index in component)
    return max((found[time] for time in points), default=0)


def _rows(block: Any, time: float) -> dict[str, Any]:
    rows: dict[str, Any] = {}
    for name in block.record.names_of_states:
        if f"{name}_equation" in block.record.generated_rows:
            rows[f"ode of {name}"] = block.component(f"{name}_equation")[time]
    for statement in block.record.statements:
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


def sides_of(data: Any) -> tuple[Any, ...]:
    """Both sides of a pair of this package or of `pyomo.mpec`, as stated; of a row or an objective what it holds."""
    if data.ctype in (Constraint, Objective):
        return (as_read(data).expr,)
    return tuple(data.args if data.ctype is Complementarity else (data._args or ()))


def _variables_in(expressions: Iterable[Any]) -> Iterator[Any]:
    for expression in expressions:
        if hasattr(expression, "is_expression_type"):
            yield from variables_in(expression, include_fixed=True)
