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
from .generated import OCCASIONAL, component_of, new_row, put, take_away
from .pairs import home_of
from .record import BLOCK_NAME, Group, Record, RelaxedPair, record_of
from .relaxations.protocol import Abilities
from .side_rows import PreparedStatement, prepare


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
        prepared, formulations = _planned(record, model, forms, fresh)
        objective = None
        if record.objective is not None:
            objective = charged_objective(record, formulations)
    except BaseException:
        for home, _ in fresh:
            del record.blocks[home]
        _drop_empty(record)
        raise
    for each in prepared:
        _put_statement(record, each)
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
        formulation = formulate(record, record.blocks[group.home], group, left) if left else Formulation(group, [])
        _put_group(record, formulation)
        if not left:
            dissolved.add(id(group))
            if group.name is not None:
                del record.named_groups[group.name]
    record.groups = [group for group in record.groups if id(group) not in dissolved]
    _drop_empty(record)
    if record.objective is not None:
        set_objective(record, charged_objective(record, ()))


def _planned(
    record: Record, model: Any, forms: Sequence[CanonicalForm], fresh: list[tuple[Any, Any]]
) -> tuple[list[PreparedStatement], list[Formulation]]:
    """Say what each statement and each group that changes or appears needs."""
    prepared = []
    by_home: dict[int, tuple[Any, list[RelaxedPair]]] = {}
    homes: dict[int, Any] = {}
    for form in forms:
        parent = form.source.parent_block()
        home = homes.get(id(parent))
        if home is None:
            home = homes[id(parent)] = home_of(parent, model)
            by_home.setdefault(id(home), (home, []))
        each = prepare(record, _block_on(record, model, home, fresh), home, form)
        prepared.append(each)
        by_home[id(home)][1].extend(each.statement.pairs)
    formulations = []
    for home, members in by_home.values():
        if members and home is not model and record.abilities.charges_products:
            raise ComplementarityError(
                f"'{members[0].pair.name}': lies in the disjunct '{home.name}', and a term of the objective would "
                "count whether or not the disjunct is chosen. Bound the products instead, for example by 'scholtes'."
            )
        block = record.blocks[home]
        for group, pairs in _grouped(record, model, home, members):
            formulations.append(formulate(record, block, group, pairs))
    return prepared, formulations


def _grouped(
    record: Record, model: Any, home: Any, members: list[RelaxedPair]
) -> list[tuple[Group, list[RelaxedPair]]]:
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
    found = []
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


def _put_statement(record: Record, prepared: PreparedStatement) -> None:
    statement = prepared.statement
    source = statement.form.source
    record.statements[source] = statement
    if prepared.variables:
        for variable in prepared.variables:
            put(record, "lifted", variable)
        statement.variables = prepared.variables
    for slack in prepared.slacks:
        put(record, "states", slack)
    if prepared.sides or prepared.definitions:
        block = record.blocks[prepared.home]
        for name, expressions in (("sides", prepared.sides), ("definitions", prepared.definitions)):
            for expression in expressions:
                row = new_row(component_of(block, name), expression)
                put(record, name, row, [source])
                statement.rows.append(row)


def _put_group(record: Record, formulation: Formulation) -> None:
    """Give a group its rows: those that it has are rewritten, what is missing is added, what is left over goes."""
    group = formulation.group
    block = record.blocks[group.home]
    if not group.pairs:
        record.groups.append(group)
        if group.name is not None:
            record.named_groups[group.name] = group
    for pair in formulation.pairs:
        pair.group = group
    group.pairs = formulation.pairs
    group.rows = _rewritten(record, block, "rows", group.rows, formulation.rows)
    if formulation.shares or group.shares:
        group.shares = _kept(record, "shares", group.shares, formulation.shares)
        for share, lower in zip(group.shares, formulation.share_bounds, strict=True):
            share.setlb(lower)
        group.budgets = _rewritten(record, block, "budgets", group.budgets, formulation.budgets)
    if formulation.states or group.states:
        group.states = _kept(record, "states", group.states, formulation.states)


def _rewritten(
    record: Record, block: Any, name: str, rows: list[Any], wanted: Sequence[tuple[Any, list[Any]]]
) -> list[Any]:
    component = component_of(block, name)
    for row, (expression, sources) in zip(rows, wanted, strict=False):
        row.set_value(expression)
        record.origins[name, row.index()] = sources
    for row in rows[len(wanted) :]:
        take_away(record, row)
    kept = rows[: len(wanted)]
    for expression, sources in wanted[len(rows) :]:
        row = new_row(component, expression)
        put(record, name, row, sources)
        kept.append(row)
    return kept


def _kept(record: Record, name: str, old: list[Any], wanted: list[Any]) -> list[Any]:
    for data in wanted[len(old) :]:
        put(record, name, data)
    for data in old[len(wanted) :]:
        take_away(record, data)
    return wanted
