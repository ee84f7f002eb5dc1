"""What a group of pairs becomes: its products, the rows that bound them, and the penalty term of the objective."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from pyomo.core import Objective, minimize, quicksum

from pyrobocop_pyomo.errors import ComplementarityError

from .generated import GeneratedBlock
from .record import PairGroup, RelaxationRecord, RelaxedPair
from .units import in_units_of, without_units

# Of the even share of delta: a product's own share never falls below, since some relaxations are not smooth at zero.
SMALLEST_SHARE = 1e-3


class Product(NamedTuple):
    """A product of (sums of) sides, ``(sum_i a_i) * (sum_j b_j)``; nearly always of the two sides of one pair."""

    a_pairs: Sequence[RelaxedPair]
    b_pairs: Sequence[RelaxedPair]

    @property
    def a(self) -> Any:
        """First factor."""
        return self._sum([pair.a for pair in self.a_pairs])

    @property
    def b(self) -> Any:
        """Second factor."""
        return self._sum([pair.b for pair in self.b_pairs])

    @staticmethod
    def _sum(sides: list[Any]) -> Any:
        return without_units(sides[0]) if len(sides) == 1 else quicksum([without_units(side) for side in sides])

    @property
    def weight(self) -> Any:
        """Weight of the pair; of several, the mean."""
        if self.a_pairs is self.b_pairs and len(self.a_pairs) == 1:
            return self.a_pairs[0].pair.weight
        pairs = [*self.a_pairs, *self.b_pairs]
        return quicksum([relaxed.pair.weight for relaxed in pairs]) / len(pairs)

    @property
    def sources(self) -> list[Any]:
        """The statements that the product came from, each once."""
        if self.a_pairs is self.b_pairs and len(self.a_pairs) == 1:
            return [self.a_pairs[0].pair.source]
        found = {id(relaxed.pair.source): relaxed.pair.source for relaxed in (*self.a_pairs, *self.b_pairs)}
        return list(found.values())


@dataclass(eq=False, slots=True)
class GroupRows:
    """The rows of a group as expressions with their sources, and new parts that are not yet in any component."""

    place: GeneratedBlock
    group: PairGroup
    pairs: Sequence[RelaxedPair]
    rows: list[tuple[Any, list[Any]]] = field(default_factory=list)
    shares: list[Any] = field(default_factory=list)
    share_bounds: list[Any] = field(default_factory=list)
    budgets: list[tuple[Any, list[Any]]] = field(default_factory=list)
    states: list[Any] = field(default_factory=list)


def products(record: RelaxationRecord, pairs: Sequence[RelaxedPair]) -> list[list[Product]]:
    """The products of a group, in lists that share one bound each."""
    formed = getattr(record.grouping, "products", None)
    if formed is None:
        singles = [pairs] if len(pairs) == 1 else [[pair] for pair in pairs]
        return [[Product(single, single) for single in singles]]
    known = {id(pair.pair): pair for pair in pairs}
    try:
        return [
            [Product([known[id(a)] for a in a_pairs], [known[id(b)] for b in b_pairs]) for a_pairs, b_pairs in row]
            for row in formed([pair.pair for pair in pairs])
        ]
    except KeyError:
        raise ComplementarityError(
            f"{record.grouping} formed a product of a pair that is not in the group. "
            "products(pairs) returns lists of (pairs of the first factor, pairs of the second), of its own pairs."
        ) from None


def crossings(record: RelaxationRecord, pairs: Sequence[RelaxedPair]) -> list[tuple[RelaxedPair, RelaxedPair]]:
    """Couples of different pairs, of which a side of the first is multiplied with a side of the second; each once."""
    if getattr(record.grouping, "products", None) is None:
        return []
    found = {
        (id(first), id(second)): (first, second)
        for row in products(record, pairs)
        for product in row
        for first in product.a_pairs
        for second in product.b_pairs
        if first is not second
    }
    return list(found.values())


def rows_of_group(place: GeneratedBlock, group: PairGroup, pairs: Sequence[RelaxedPair]) -> GroupRows:
    """State the rows of a group that has these pairs; nothing is added to the model yet."""
    planned = GroupRows(place, group, pairs)
    record = place.record
    abilities = record.abilities
    formed = products(record, pairs)
    if abilities.penalises_products:
        if abilities.keeps_multipliers:
            planned.states = _states(place, group, sum(map(len, formed)), 0.0)
        return planned
    if abilities.keeps_bounds:
        planned.states = _states(place, group, len(formed), record.main.delta.value)
        bounds: Sequence[Any] = planned.states
    else:
        bounds = [place.bound] * len(formed)
    equality = abilities.equality and not _crosses(formed)
    for row, bound in zip(formed, bounds, strict=True):
        _bound_row(planned, row, bound, equality)
    return planned


def _bound_row(planned: GroupRows, row: list[Product], bound: Any, equality: bool) -> None:
    record = planned.place.record
    relaxation, abilities = record.relaxation, record.abilities
    shift = relaxation.shift(bound)
    if shift is not None and not abilities.several_rows:
        # The shift is the bound of the row and not a term of its body. So the body stays a plain product, which is
        # quicker to write, and delta moves inside a solve by moving one bound.
        residuals = [relaxation.residual(product.a, product.b, 0) for product in row]
        body = residuals[0] if len(residuals) == 1 else quicksum(residuals)
        expression = body == shift if equality else body <= shift
        planned.rows.append((expression, _sources(row)))
        return
    if len(row) == 1:
        shares = [bound]
    else:
        # Residuals without a shift cannot be added up. Each product gets a share of delta instead. If the residual
        # were the product, eliminating the shares would give the sum of the products again.
        lower = SMALLEST_SHARE / len(row) * bound
        kept = planned.group.shares[len(planned.shares) : len(planned.shares) + len(row)]
        start = record.main.delta.value / len(row)
        shares = [*kept, *(planned.place.new_variable("shares", None, start) for _ in range(len(row) - len(kept)))]
        planned.shares += shares
        planned.share_bounds += [lower] * len(row)
        planned.budgets.append((quicksum(shares) <= bound, _sources(row)))
    for product, share in zip(row, shares, strict=True):
        a, b = product.a, product.b
        residual = relaxation.residual(a, b, share)
        planned.rows.append((residual == 0 if equality else residual <= 0, product.sources))
        if abilities.several_rows:
            further = relaxation.further_residuals(a, b, share)
            planned.rows += [(further_residual <= 0, product.sources) for further_residual in further]


def _crosses(formed: list[list[Product]]) -> bool:
    """Whether a side is in several products: fixing them all would make sides equal to each other."""
    a_pairs = [id(pair) for row in formed for product in row for pair in product.a_pairs]
    b_pairs = [id(pair) for row in formed for product in row for pair in product.b_pairs]
    return len(set(a_pairs)) < len(a_pairs) or len(set(b_pairs)) < len(b_pairs)


def _states(place: GeneratedBlock, group: PairGroup, count: int, start: float) -> list[Any]:
    kept = group.states[:count]
    return [*kept, *(place.new_state(start) for _ in range(count - len(kept)))]


def _sources(row: list[Product]) -> list[Any]:
    if len(row) == 1:
        return row[0].sources
    found = {id(source): source for product in row for source in product.sources}
    return list(found.values())


def objective_with_penalty(record: RelaxationRecord, changing: Iterable[GroupRows]) -> Any:
    """The user's objective with the penalty term of all groups, of which some are about to change or to appear."""
    relaxation, main = record.relaxation, record.main
    if record.abilities.penalises_products:
        current: dict[int, PairGroup | GroupRows] = {id(group): group for group in record.groups}
        current.update((id(planned.group), planned) for planned in changing)
        amount = quicksum([term for group in current.values() for term in _terms(record, group.pairs, group.states)])
    else:
        amount = main.excess
    term = relaxation.coefficient(main.delta) * amount
    if record.objective is None:
        return term
    term = in_units_of(term, record.objective)
    # The user's objective enters by name: what is later assigned to it is followed.
    return record.objective + term if record.objective.is_minimizing() else record.objective - term


def set_objective(record: RelaxationRecord, expression: Any) -> None:
    """Put the generated objective in the place of the user's."""
    block = record.main
    if block.component("objective") is None:
        users = record.objective
        block.objective = Objective(expr=expression, sense=minimize if users is None else users.sense)
        if users is not None:
            users.deactivate()
    else:
        block.objective.set_value(expression)


def _terms(record: RelaxationRecord, pairs: Sequence[RelaxedPair], states: Sequence[Any]) -> list[Any]:
    formed = [product for row in products(record, pairs) for product in row]
    # A factor of one is dropped by Pyomo itself.
    if record.abilities.keeps_multipliers:
        penalty = record.relaxation.penalty
        return [
            product.weight * penalty(product.a * product.b, state)
            for product, state in zip(formed, states, strict=True)
        ]
    return [product.weight * (product.a * product.b) for product in formed]
