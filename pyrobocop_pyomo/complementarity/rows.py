"""Building and unbuilding the generated rows of a relaxed model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pyomo.common.modeling import unique_component_name
from pyomo.core import Block, NonNegativeReals, Param, Var

from pyrobocop_pyomo.errors import ComplementarityError

from .canonical import CanonicalForm
from .charge import charged_objective, set_objective
from .formulation import Formulation, formulate
from .generated import OCCASIONAL, GeneratedBlock, component_of, take_away
from .pairs import home_of
from .record import BLOCK_NAME, Group, Record, RelaxedPair, RelaxedStatement, record_of
from .relaxations.protocol import Abilities
from .side_rows import Preparation


def new_record(delta: float, relaxation: Any, grouping: Any, lift: bool, objective: Any) -> Record:
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


def add_statements(record: Record, model: Any, forms: Sequence[CanonicalForm]) -> None:
    """Add rows (or the objective's terms) for the statements.

    Whatever can fail is computed before the first component of the model is touched.
    """
    fresh: list[tuple[Any, Any]] = []
    _block_on(record, model, model, fresh)
    try:
        statements, preparations, formulations = _planned(record, model, forms, fresh)
        objective = None
        if record.abilities.has_penalty:
            objective = charged_objective(record, formulations)
    except BaseException:
        for home, _ in fresh:
            del record.blocks[home]
        _drop_empty(record)
        raise
    for statement in statements:
        record.statements[statement.form.source] = statement
    for preparation in preparations:
        _put_sides(preparation)
    for formulation in formulations:
        _put_group(record, formulation)
    if objective is not None:
        set_objective(record, objective)
    for home, block in fresh:
        home.add_component(unique_component_name(home, BLOCK_NAME), block)


def remove_statements(record: Record, sources: Sequence[Any]) -> None:
    """Take away what was generated for these sources; where nothing is left, everything generated goes."""
    gone = {id(source) for source in sources}
    if len(gone) == len(record.statements):
        for block in record.blocks.values():
            block.parent_block().del_component(block)
        if record.objective is not None:
            record.objective.activate()
        return
    groups: dict[int, Group] = {}
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
        _put_group(record, formulate(place, group, left) if left else Formulation(place, group, []))
        if not left:
            dissolved.add(id(group))
            if group.name is not None:
                del record.named_groups[group.name]
    record.groups = [group for group in record.groups if id(group) not in dissolved]
    _drop_empty(record)
    if record.abilities.has_penalty:
        set_objective(record, charged_objective(record, ()))


def _planned(
    record: Record, model: Any, forms: Sequence[CanonicalForm], fresh: list[tuple[Any, Any]]
) -> tuple[list[RelaxedStatement], list[Preparation], list[Formulation]]:
    """Say what each statement and each group that changes or appears needs."""
    statements = []
    by_home: dict[int, tuple[Any, Preparation]] = {}
    by_parent: dict[int, Preparation] = {}
    for form in forms:
        parent = form.source.parent_block()
        preparation = by_parent.get(id(parent))
        if preparation is None:
            home = home_of(parent, model)
            if id(home) not in by_home:
                place = GeneratedBlock(record, _block_on(record, model, home, fresh))
                by_home[id(home)] = (home, Preparation(place))
            preparation = by_parent[id(parent)] = by_home[id(home)][1]
        statements.append(preparation.add(form))
    formulations = []
    for home, preparation in by_home.values():
        members = preparation.pairs
        if members and home is not model and record.abilities.penalises_products:
            raise ComplementarityError(
                f"'{members[0].pair.name}': lies in the disjunct '{home.name}', and a term of the objective would "
                "count whether or not the disjunct is chosen. Bound the products instead, for example by 'scholtes'."
            )
        for group, pairs in _grouped(record, model, home, members):
            formulations.append(formulate(preparation.place, group, pairs))
    return statements, [preparation for _, preparation in by_home.values()], formulations


def _grouped(
    record: Record, model: Any, home: Any, members: list[RelaxedPair]
) -> list[tuple[Group, Sequence[RelaxedPair]]]:
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
    found: list[tuple[Group, Sequence[RelaxedPair]]] = []
    for name, added in groups:
        if name is not None and home is not model:
            # A grouping of somebody else may give one name to pairs of several disjuncts.
            name = (home.name, name)
        group = None if name is None else record.named_groups.get(name)
        if group is None:
            group = Group(home, name)
        joined = [relaxed[id(pair)] for pair in added]
        found.append((group, [*group.pairs, *joined] if group.pairs else joined))
    return found


def _block_on(record: Record, model: Any, home: Any, fresh: list[tuple[Any, Any]]) -> Any:
    """The generated block of a home; a missing one is made, and attached when it is complete."""
    block = record.blocks.get(home)
    if block is None:
        block = record.main if home is model else Block(concrete=True)
        record_of(block).main = record.main
        component_of(block, "rows")
        component_of(block, "sides")
        record.blocks[home] = block
        fresh.append((home, block))
    return block


def _drop_empty(record: Record) -> None:
    """Take away components that were made for something and hold nothing (any more)."""
    for block in record.blocks.values():
        for name in OCCASIONAL:
            component = block.component(name)
            if component is not None and not component:
                block.del_component(component)


def _put_sides(preparation: Preparation) -> None:
    """Put what the statements of one home need beyond their products into the components."""
    place = preparation.place
    for variable in preparation.variables:
        place.put("lifted", variable)
    for slack in preparation.slacks:
        place.put("states", slack)
    for name, rows in (("sides", preparation.sides), ("definitions", preparation.definitions)):
        for statement, expression in rows:
            statement.rows += (place.put_row(name, expression, [statement.form.source]),)


def _put_group(record: Record, formulation: Formulation) -> None:
    """Give a group its rows: those that it has are rewritten, what is missing is added, what is left over goes."""
    group, place = formulation.group, formulation.place
    if not group.pairs:
        record.groups.append(group)
        if group.name is not None:
            record.named_groups[group.name] = group
    for pair in formulation.pairs:
        pair.group = group
    group.pairs = formulation.pairs
    group.rows = _rewritten(place, "rows", group.rows, formulation.rows)
    if formulation.shares or group.shares:
        group.shares = _kept(place, "shares", group.shares, formulation.shares)
        for share, lower in zip(group.shares, formulation.share_bounds, strict=True):
            share.setlb(lower)
        group.budgets = _rewritten(place, "budgets", group.budgets, formulation.budgets)
    if formulation.states or group.states:
        group.states = _kept(place, "states", group.states, formulation.states)


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
