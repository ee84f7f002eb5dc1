"""Building and unbuilding the generated rows of a relaxed model."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from pyomo.common.modeling import unique_component_name
from pyomo.core import Block, Constraint, NonNegativeIntegers, NonNegativeReals, Objective, Param, quicksum
from pyomo.gdp import Disjunct

from pyrobocop_pyomo.errors import ComplementarityError

from .canonical import CanonicalForm, CanonicalPair, Part
from .record import BLOCK_NAME, Group, Record, record_of
from .relaxations import Scholtes


def new_record(delta: float, relaxation: Any, grouping: Any, objective: Any) -> Record:
    """Make a generated block that is in no model yet, with delta on it, and return its record."""
    block = Block(concrete=True)
    # Zero is allowed: products bounded by zero are the pairs themselves, and some solvers can hold them.
    block.delta = Param(initialize=delta, mutable=True, domain=NonNegativeReals, doc="bound of the products")
    record = record_of(block)
    record.main = block
    record.relaxation = relaxation
    record.grouping = grouping
    record.objective = objective
    return record


def add_forms(record: Record, model: Any, forms: Sequence[CanonicalForm]) -> None:
    """Add rows (or the objective's terms) for the pairs of statements, and the rows that they need beside them.

    Whatever can fail is computed before the first component of the model is touched.
    """
    pairs = [pair for form in forms for pair in form.pairs]
    homes = _homes(model, forms)
    groups = _planned(record, model, pairs, homes)
    objective = _charged(record, [*record.pairs, *pairs]) if record.objective is not None else None

    fresh = _blocks_for(record, model, list(homes.values()))
    for form in forms:
        record.forms[form.source] = form
        record.side_rows[form.source] = []
        record.group_names[form.source] = []
    for name, group, expression in groups:
        _set_row(record, name, group, expression)
    for form in forms:
        block = record.blocks[homes[id(form.source)]]
        for expression in _side_rows(form):
            position = record.take_position("sides")
            block.sides[position] = expression
            row = block.sides[position]
            record.side_rows[form.source].append(row)
            record.sources[row] = [form.source]
    if objective is not None:
        _set_objective(record, objective)
    for home, block in fresh:
        home.add_component(unique_component_name(home, BLOCK_NAME), block)


def _side_rows(form: CanonicalForm) -> list[Any]:
    rows = [row for pair in form.pairs for row in (pair.a_row, pair.b_row)]
    return [row for row in (*rows, *form.rows) if row is not None]


def remove_forms(record: Record, sources: Sequence[Any]) -> None:
    """Take the rows of these statements away; where nothing is left, everything generated goes."""
    gone = {id(source) for source in sources}
    if len(gone) == len(record.forms):
        for block in record.blocks.values():
            block.parent_block().del_component(block)
        if record.objective is not None:
            record.objective.activate()
        return
    for name in dict.fromkeys(name for source in sources for name in record.group_names[source]):
        group = record.groups[name]
        group.pairs = [pair for pair in group.pairs if id(pair.source) not in gone]
        if group.pairs:
            _set_row(record, name, group, _row(record, name, group.pairs))
        else:
            _delete_row(record, group.row)
            del record.groups[name]
    for source in sources:
        for row in record.side_rows[source]:
            _delete_row(record, row)
        for known in (record.side_rows, record.forms, record.group_names):
            del known[source]
    if record.objective is not None:
        _set_objective(record, _charged(record, record.pairs))


def _homes(model: Any, forms: Iterable[CanonicalForm]) -> dict[int, Any]:
    """From the id of each statement to the block that its rows belong on."""
    found: dict[int, Any] = {}
    by_parent: dict[int, Any] = {}
    for form in forms:
        parent = form.source.parent_block()
        if id(parent) not in by_parent:
            by_parent[id(parent)] = _home(parent, model)
        found[id(form.source)] = by_parent[id(parent)]
    return found


def _planned(
    record: Record, model: Any, pairs: Sequence[CanonicalPair], homes: dict[int, Any]
) -> list[tuple[str, Group, Any]]:
    """Say which group changes or appears, and what its row will be."""
    by_home: dict[int, tuple[Any, list[CanonicalPair]]] = {}
    for pair in pairs:
        home = homes[id(pair.source)]
        by_home.setdefault(id(home), (home, []))[1].append(pair)
    planned = []
    for home, members in by_home.values():
        if record.objective is not None and home is not model:
            raise ComplementarityError(
                f"'{members[0].name}': lies in the disjunct '{home.name}', and a term of the objective would count "
                "whether or not the disjunct is chosen. Bound the products instead, for example by 'scholtes'."
            )
        groups = record.grouping.groups(members)
        count = sum(len(added) for _, added in groups)
        if count != len(members):
            raise ComplementarityError(
                f"'{model.name}': {record.grouping} put {count} pairs into groups, "
                f"of {len(members)} pairs. A grouping returns every pair once."
            )
        for name, added in groups:
            if home is not model:
                # A grouping of somebody else may give one name to pairs of several disjuncts.
                name = f"{home.name}: {name}"
            known = record.groups.get(name)
            group = Group(home, known.row if known else None, [*(known.pairs if known else ()), *added])
            planned.append((name, group, _row(record, name, group.pairs)))
    return planned


def _home(block: Any, model: Any) -> Any:
    """Where the rows go: on the model, but for pairs of a disjunct on the disjunct, which may not be chosen."""
    while block is not model:
        if block.ctype is Disjunct:
            return block
        block = block.parent_block()
    return model


def _row(record: Record, name: str, pairs: Sequence[CanonicalPair]) -> Any:
    relaxation, delta = record.relaxation, record.main.delta
    _refuse_parts(relaxation, name, pairs)
    if record.objective is not None:
        return None
    if pairs[0].b_part is not Part.WHOLE:
        return pairs[0].product <= delta
    shift = relaxation.shift(delta)
    if shift is not None:
        # The shift is the row's bound and not a term of its body: the body stays a plain product, which is
        # quicker to write, and whoever moves delta inside a solve moves one bound.
        if len(pairs) == 1:
            return relaxation.residual(pairs[0].a, pairs[0].b, 0) <= shift
        return quicksum([relaxation.residual(pair.a, pair.b, 0) for pair in pairs]) <= shift
    if len(pairs) > 1:
        raise ComplementarityError(
            f"'{name}': {len(pairs)} pairs share a row, but the residuals of {relaxation} cannot be added up under "
            "one delta. Use grouping='pair'."
        )
    return relaxation.residual(pairs[0].a, pairs[0].b, delta) <= 0


def _refuse_parts(relaxation: Any, name: str, pairs: Sequence[CanonicalPair]) -> None:
    """Refuse what would misread ``(F - l) * H <= delta``, which is negative where H is, and not zero."""
    part = next((pair for pair in pairs if pair.b_part is not Part.WHOLE), None)
    if part is None or (len(pairs) == 1 and isinstance(relaxation, Scholtes)):
        return
    why = f"under {relaxation}" if len(pairs) == 1 else f"in a sum of {len(pairs)} products, '{name}'"
    raise ComplementarityError(
        f"'{part.source.name}': is a range whose free side takes both signs; {why} its products would cancel "
        "others or reward a violation. Use relaxation='scholtes' with grouping='pair'."
    )


def _blocks_for(record: Record, model: Any, homes: Sequence[Any]) -> list[tuple[Any, Any]]:
    """Make the generated blocks that are missing; they are attached when they are complete."""
    fresh = []
    for home in [model, *homes]:
        if home in record.blocks:
            continue
        block = record.main if home is model else Block(concrete=True)
        record_of(block).main = record.main
        block.rows = Constraint(NonNegativeIntegers)
        block.sides = Constraint(NonNegativeIntegers)
        record.blocks[home] = block
        fresh.append((home, block))
    return fresh


def _set_row(record: Record, name: str, group: Group, expression: Any) -> None:
    record.groups[name] = group
    if expression is not None:
        if group.row is None:
            rows = record.blocks[group.home].rows
            position = record.take_position("rows")
            rows[position] = expression
            group.row = rows[position]
        else:
            group.row.set_value(expression)
        record.sources[group.row] = [pair.source for pair in group.pairs]
    for pair in group.pairs:
        if name not in record.group_names[pair.source]:
            record.group_names[pair.source].append(name)


def _delete_row(record: Record, row: Any) -> None:
    if row is not None:
        del record.sources[row]
        del row.parent_component()[row.index()]


def _charged(record: Record, pairs: Iterable[CanonicalPair]) -> Any:
    # A factor of one is dropped by Pyomo itself.
    products = [pair.weight * (pair.a * pair.b) for pair in pairs]
    term = record.relaxation.coefficient(record.main.delta) * quicksum(products)
    # The user's objective enters by name: what is later assigned to it is followed.
    return record.objective + term if record.objective.is_minimizing() else record.objective - term


def _set_objective(record: Record, expression: Any) -> None:
    block = record.main
    if block.component("objective") is None:
        block.objective = Objective(expr=expression, sense=record.objective.sense)
        record.objective.deactivate()
    else:
        block.objective.set_value(expression)
