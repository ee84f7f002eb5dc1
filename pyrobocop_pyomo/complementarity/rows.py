"""Building the generated rows of a relaxed model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from pyomo.common.modeling import unique_component_name
from pyomo.core import Block, NonNegativeReals, Param, Var

from pyrobocop_pyomo.errors import ComplementarityError

from .canonical import CanonicalForm
from .generated import GeneratedBlock
from .group_rows import objective_with_penalty, rows_of_group
from .lifting import relaxed_pairs
from .pairs import home_of
from .record import BLOCK_NAME, PairGroup, RelaxationRecord, RelaxedPair, RelaxedStatement, record_of
from .relaxations import ObjectiveTerm


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
    # Asked once: a check of the protocols for each pair would be slow.
    is_penalty = isinstance(relaxation, ObjectiveTerm)
    record.penalises_products = is_penalty and excess is None
    record.shifts = not is_penalty and relaxation.shift(block.delta) is not None
    record.grouping = grouping
    record.lift = lift
    record.objective = objective
    return record


def state_rows(record: RelaxationRecord, model: Any, forms: Sequence[CanonicalForm]) -> None:
    """State the rows of the statements, or terms of the objective.

    All that can fail is done on blocks that are no part of the model yet.
    """
    by_home: dict[int, tuple[Any, list[RelaxedStatement]]] = {id(model): (model, [])}
    homes: dict[int, Any] = {}  # by the block of a statement: looking it up each time would take as long as a row
    for form in forms:
        statement = record.statements[form.source] = RelaxedStatement(form)
        parent = form.source.parent_block()
        if id(parent) not in homes:
            homes[id(parent)] = home_of(parent, model)
        home = homes[id(parent)]
        by_home.setdefault(id(home), (home, []))[1].append(statement)
    counts: Counter[str] = Counter()
    for home, statements in by_home.values():
        block = record.blocks[home] = record.main if home is model else Block(concrete=True)
        record_of(block).main = record.main
        place = GeneratedBlock(record, block, counts)
        for statement in statements:
            statement.pairs = relaxed_pairs(place, statement.form)
        members = [pair for statement in statements for pair in statement.pairs]
        if members and home is not model and record.penalises_products:
            raise ComplementarityError(
                f"'{members[0].pair.name}': lies in the disjunct '{home.name}', and a term of the objective would "
                "count whether or not the disjunct is chosen. Bound the products instead, for example by 'scholtes'."
            )
        for pairs in _grouped(record, model, members):
            record.groups.append(PairGroup(home, pairs, rows_of_group(place, pairs)))
    if isinstance(record.relaxation, ObjectiveTerm):
        record.main.objective = objective_with_penalty(record)
    for home, block in record.blocks.items():
        home.add_component(unique_component_name(home, BLOCK_NAME), block)
    if record.objective is not None:
        record.objective.deactivate()


def _grouped(record: RelaxationRecord, model: Any, members: list[RelaxedPair]) -> Iterator[list[RelaxedPair]]:
    """Ask the grouping; yields the pairs of each group."""
    relaxed = {id(member.pair): member for member in members}
    groups = record.grouping.groups([member.pair for member in members])
    count = sum(len(pairs) for _, pairs in groups)
    named = {id(pair) for _, pairs in groups for pair in pairs}
    if count != len(members) or len(named) != count or not named <= relaxed.keys():
        raise ComplementarityError(
            f"'{model.name}': {record.grouping} put {count} pairs into groups, "
            f"of {len(members)} pairs. A grouping returns every pair once."
        )
    return ([relaxed[id(pair)] for pair in pairs] for _, pairs in groups)
