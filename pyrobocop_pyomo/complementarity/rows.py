"""Building and unbuilding the generated rows of a relaxed model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pyomo.common.modeling import unique_component_name
from pyomo.core import Block, NonNegativeReals, Param, Var

from pyrobocop_pyomo.errors import ComplementarityError

from .canonical import CanonicalForm
from .generated import OCCASIONAL, GeneratedBlock, component_of, take_away
from .group_rows import GroupRows, objective_with_penalty, rows_of_group, set_objective
from .lifting import SideRows
from .pairs import home_of
from .record import BLOCK_NAME, PairGroup, RelaxationRecord, RelaxedPair, RelaxedStatement, record_of
from .relaxations.protocol import Abilities


def new_record(delta: float, relaxation: Any, grouping: Any, lift: bool, objective: Any) -> RelaxationRecord:
    """Make a generated block that is in no model yet, with delta on it, and return its record."""
    block = Block(concrete=True)
    # Zero is allowed: products bounded by zero are the pairs themselves, and some solvers can hold them.
    block.delta = Param(initialize=delta, mutable=True, domain=NonNegativeReals, doc="bound of the products")
    excess = getattr(relaxation, "excess_bound", None)
    if excess is not None:
        block.excess = Var(bounds=(0, excess), initialize=min(1.0, excess), doc="bound of the products, paid for")
    record = record_of(block)
    record.main = block
    record.relaxation = relaxation
    record.abilities = Abilities.of(relaxation, block.delta)
    record.grouping = grouping
    record.lift = lift
    record.objective = objective
    return record


def add_statements(record: RelaxationRecord, model: Any, forms: Sequence[CanonicalForm]) -> None:
    """Add rows, or terms of the objective, for the statements.

    Everything that can fail is computed before the first component of the model is touched.
    """
    fresh: list[tuple[Any, Any]] = []
    _block_on(record, model, model, fresh)
    try:
        statements, planned_sides, planned_groups = _planned(record, model, forms, fresh)
        objective = None
        if record.abilities.has_penalty:
            objective = objective_with_penalty(record, planned_groups)
    except BaseException:
        for home, _ in fresh:
            del record.blocks[home]
        _drop_empty(record)
        raise
    for statement in statements:
        record.statements[statement.form.source] = statement
    for sides in planned_sides:
        _put_sides(sides)
    for planned in planned_groups:
        _put_group(record, planned)
    if objective is not None:
        set_objective(record, objective)
    for home, block in fresh:
        home.add_component(unique_component_name(home, BLOCK_NAME), block)


def remove_statements(record: RelaxationRecord, sources: Sequence[Any]) -> None:
    """Remove what was generated for these sources; with the last source the generated blocks are removed as well."""
    gone = {id(source) for source in sources}
    if len(gone) == len(record.statements):
        for block in record.blocks.values():
            block.parent_block().del_component(block)
        if record.objective is not None:
            record.objective.activate()
        return
    groups: dict[int, PairGroup] = {}
    for source in sources:
        statement = record.statements.pop(source)
        for data in (*statement.rows, *statement.variables):
            take_away(record, data)
        groups.update((id(pair.group), pair.group) for pair in statement.pairs)
        for pair in statement.pairs:
            for slack in (pair.a_slack, pair.b_slack):
                if slack is not None:
                    take_away(record, slack)
    dissolved = set()
    for group in groups.values():
        left = [pair for pair in group.pairs if id(pair.pair.source) not in gone]
        # A group without pairs has no rows either: formulating it takes the old ones away.
        place = GeneratedBlock(record, record.blocks[group.home])
        _put_group(record, rows_of_group(place, group, left) if left else GroupRows(place, group, []))
        if not left:
            dissolved.add(id(group))
            if group.name is not None:
                del record.named_groups[group.name]
    record.groups = [group for group in record.groups if id(group) not in dissolved]
    _drop_empty(record)
    if record.abilities.has_penalty:
        set_objective(record, objective_with_penalty(record, ()))


def _planned(
    record: RelaxationRecord, model: Any, forms: Sequence[CanonicalForm], fresh: list[tuple[Any, Any]]
) -> tuple[list[RelaxedStatement], list[SideRows], list[GroupRows]]:
    """Plan the parts of each statement, and of each group that changes or appears."""
    statements = []
    by_home: dict[int, tuple[Any, SideRows]] = {}
    by_parent: dict[int, SideRows] = {}
    for form in forms:
        parent = form.source.parent_block()
        sides = by_parent.get(id(parent))
        if sides is None:
            home = home_of(parent, model)
            if id(home) not in by_home:
                place = GeneratedBlock(record, _block_on(record, model, home, fresh))
                by_home[id(home)] = (home, SideRows(place))
            sides = by_parent[id(parent)] = by_home[id(home)][1]
        statements.append(sides.add(form))
    planned_groups = []
    for home, sides in by_home.values():
        members = sides.pairs
        if members and home is not model and record.abilities.penalises_products:
            raise ComplementarityError(
                f"'{members[0].pair.name}': lies in the disjunct '{home.name}', and a term of the objective would "
                "count whether or not the disjunct is chosen. Bound the products instead, for example by 'scholtes'."
            )
        for group, pairs in _grouped(record, model, home, members):
            planned_groups.append(rows_of_group(sides.place, group, pairs))
    return statements, [sides for _, sides in by_home.values()], planned_groups


def _grouped(
    record: RelaxationRecord, model: Any, home: Any, members: list[RelaxedPair]
) -> list[tuple[PairGroup, Sequence[RelaxedPair]]]:
    """Ask the grouping; returns the groups, known or new, with all their pairs."""
    relaxed = {id(member.pair): member for member in members}
    groups = record.grouping.groups([member.pair for member in members])
    count = sum(len(added) for _, added in groups)
    named = {id(pair) for _, added in groups for pair in added}
    if count != len(members) or len(named) != count or not named <= relaxed.keys():
        raise ComplementarityError(
            f"'{model.name}': {record.grouping} put {count} pairs into groups, "
            f"of {len(members)} pairs. A grouping returns every pair once."
        )
    found: list[tuple[PairGroup, Sequence[RelaxedPair]]] = []
    for name, added in groups:
        if name is not None and home is not model:
            # A grouping of somebody else may give one name to pairs of several disjuncts.
            name = (home.name, name)
        group = None if name is None else record.named_groups.get(name)
        if group is None:
            group = PairGroup(home, name)
        joined = [relaxed[id(pair)] for pair in added]
        found.append((group, [*group.pairs, *joined] if group.pairs else joined))
    return found


def _block_on(record: RelaxationRecord, model: Any, home: Any, fresh: list[tuple[Any, Any]]) -> Any:
    """The generated block of a home; a missing one is made, and is added to the model when it is complete."""
    block = record.blocks.get(home)
    if block is None:
        block = record.main if home is model else Block(concrete=True)
        record_of(block).main = record.main
        component_of(block, "rows")
        component_of(block, "sides")
        record.blocks[home] = block
        fresh.append((home, block))
    return block


def _drop_empty(record: RelaxationRecord) -> None:
    """Remove the occasional components that are empty."""
    for block in record.blocks.values():
        for name in OCCASIONAL:
            component = block.component(name)
            if component is not None and not component:
                block.del_component(component)


def _put_sides(sides: SideRows) -> None:
    """Put the variables, slacks and rows of the sides into the components."""
    place = sides.place
    for variable in sides.variables:
        place.put("lifted", variable)
    for slack in sides.slacks:
        place.put("states", slack)
    for name, rows in (("sides", sides.sides), ("definitions", sides.definitions)):
        for statement, expression in rows:
            statement.rows += (place.put_row(name, expression, [statement.form.source]),)


def _put_group(record: RelaxationRecord, planned: GroupRows) -> None:
    """Give a group its rows: present ones are rewritten, missing ones are added, and superfluous ones are removed."""
    group, place = planned.group, planned.place
    if not group.pairs:
        record.groups.append(group)
        if group.name is not None:
            record.named_groups[group.name] = group
    for pair in planned.pairs:
        pair.group = group
    group.pairs = planned.pairs
    group.rows = _rewritten(place, "rows", group.rows, planned.rows)
    if planned.shares or group.shares:
        group.shares = _kept(place, "shares", group.shares, planned.shares)
        for share, lower in zip(group.shares, planned.share_bounds, strict=True):
            share.setlb(lower)
        group.budgets = _rewritten(place, "budgets", group.budgets, planned.budgets)
    if planned.states or group.states:
        group.states = _kept(place, "states", group.states, planned.states)


def _rewritten(
    place: GeneratedBlock, name: str, rows: Sequence[Any], wanted: Sequence[tuple[Any, list[Any]]]
) -> Sequence[Any]:
    if not rows:
        return [place.put_row(name, expression, sources) for expression, sources in wanted]
    record = place.record
    for row, (expression, sources) in zip(rows, wanted, strict=False):
        row.set_value(expression)
        record.origins[name, row.index()] = sources
    for row in rows[len(wanted) :]:
        take_away(record, row)
    added = [place.put_row(name, expression, sources) for expression, sources in wanted[len(rows) :]]
    return [*rows[: len(wanted)], *added]


def _kept(place: GeneratedBlock, name: str, old: Sequence[Any], wanted: list[Any]) -> list[Any]:
    for data in wanted[len(old) :]:
        place.put(name, data)
    for data in old[len(wanted) :]:
        take_away(place.record, data)
    return wanted
