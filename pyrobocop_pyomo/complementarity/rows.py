"""Building the generated block of a relaxed model: rows that bound products, rows of sides, and the penalty term."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from pyomo.common.modeling import unique_component_name
from pyomo.core import Block, Constraint, Objective, Param, Var, minimize, quicksum
from pyomo.core.base.set import NonNegativeIntegers, NonNegativeReals

from pyrobocop_pyomo.errors import ComplementarityError

from .canonical import CanonicalForm
from .lifting import relaxed_pairs
from .record import BLOCK_NAME, RelaxationRecord, RelaxedPair, RelaxedStatement, record_of
from .relaxations import ObjectiveTerm
from .units import in_units_of, without_units


class Product(NamedTuple):
    """A product of a side of one pair and a side of another one; nearly always of the two sides of one pair."""

    a_pair: RelaxedPair
    b_pair: RelaxedPair

    @property
    def a(self) -> Any:
        """First factor."""
        return without_units(self.a_pair.a)

    @property
    def b(self) -> Any:
        """Second factor."""
        return without_units(self.b_pair.b)

    @property
    def weight(self) -> Any:
        """Weight of the pair; of two, the mean."""
        first, second = self.a_pair.pair.weight, self.b_pair.pair.weight
        return first if self.a_pair is self.b_pair else (first + second) / 2


def new_record(delta: float, relaxation: Any, grouping: Any, lift: bool, objective: Any) -> RelaxationRecord:
    """Make a generated block that is in no model yet, with delta on it, and return its record."""
    block = Block(concrete=True)
    # Zero is allowed: products bounded by zero are the pairs themselves, and some solvers can hold them.
    block.delta = Param(initialize=delta, mutable=True, domain=NonNegativeReals, doc="bound of the products")
    excess = getattr(relaxation, "excess_bound", None)
    if excess is not None:
        block.excess = Var(bounds=(0, excess), initialize=min(1.0, excess), doc="bound of the products, paid for")
    block.rows = Constraint(NonNegativeIntegers, doc="bound the products")
    block.sides = Constraint(NonNegativeIntegers, doc="keep the signs of the sides")
    block.lifted = Var(NonNegativeIntegers, dense=False, doc="stand for sides that are no variables")
    block.definitions = Constraint(NonNegativeIntegers, doc="define the lifted variables")
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

    All that can fail is done on a block that is no part of the model yet.
    """
    for form in forms:
        statement = record.statements[form.source] = RelaxedStatement(form)
        statement.pairs = relaxed_pairs(record, form)
    for pairs in _grouped(record, model, list(record.relaxed_pairs)):
        record.products += _products(record, pairs)
    if not record.penalises_products:
        for shared in record.products:
            _put_bounds(record, shared)
    if isinstance(record.relaxation, ObjectiveTerm):
        record.main.objective = _objective_with_penalty(record)
    model.add_component(unique_component_name(model, BLOCK_NAME), record.main)
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


def _products(record: RelaxationRecord, pairs: Sequence[RelaxedPair]) -> list[list[Product]]:
    """The products of a group, in lists that share one bound each."""
    formed = getattr(record.grouping, "products", None)
    if formed is None:
        return [[Product(pair, pair) for pair in pairs]]
    known = {id(pair.pair): pair for pair in pairs}
    try:
        return [[Product(known[id(a)], known[id(b)])] for a, b in formed([pair.pair for pair in pairs])]
    except KeyError:
        raise ComplementarityError(
            f"{record.grouping} formed a product of a pair that is not in the group. "
            "products(pairs) returns a list of (pair of the first factor, pair of the second), of its own pairs."
        ) from None


def _put_bounds(record: RelaxationRecord, shared: list[Product]) -> None:
    """State the rows that bound some products together."""
    relaxation, bound = record.relaxation, record.bound
    shift = relaxation.shift(bound)
    if shift is not None:
        # The shift is the bound of the row and not a term of its body. So the body stays a plain product, which is
        # quicker to write, and delta moves inside a solve by moving one bound.
        residuals = [relaxation.residual(product.a, product.b, 0) for product in shared]
        body = residuals[0] if len(residuals) == 1 else quicksum(residuals)
        record.bounds.append(record.put_row("rows", body <= shift, _sources(shared)))
        return
    # Residuals without a shift cannot be added up: each product is bounded by itself.
    for product in shared:
        row = relaxation.residual(product.a, product.b, bound) <= 0
        record.bounds.append(record.put_row("rows", row, _sources([product])))


def _sources(shared: list[Product]) -> list[Any]:
    """The statements that products came from, each once."""
    sources = [relaxed.pair.source for product in shared for relaxed in product]
    return list({id(source): source for source in sources}.values())


def _objective_with_penalty(record: RelaxationRecord) -> Objective:
    """The user's objective with the penalty term of all groups."""
    users, main = record.objective, record.main
    if record.penalises_products:
        # A factor of one is dropped by Pyomo itself.
        amount = quicksum([each.weight * (each.a * each.b) for shared in record.products for each in shared])
    else:
        amount = main.excess
    term = record.relaxation.coefficient(main.delta) * amount
    if users is None:
        return Objective(expr=term, sense=minimize)
    term = in_units_of(term, users)
    # The user's objective enters by name: what is later assigned to it is followed.
    return Objective(expr=users + term if users.is_minimizing() else users - term, sense=users.sense)
