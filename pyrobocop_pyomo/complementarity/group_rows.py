"""What a group of pairs becomes: its products, the rows that bound them, and the penalty term of the objective."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from pyomo.core import Objective, minimize, quicksum

from pyrobocop_pyomo.errors import ComplementarityError

from .generated import GeneratedBlock
from .record import RelaxationRecord, RelaxedPair
from .units import in_units_of, without_units


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


def rows_of_group(place: GeneratedBlock, pairs: Sequence[RelaxedPair]) -> list[Any]:
    """State the rows that bound the products of a group; none where these are in the penalty term."""
    record = place.record
    if record.abilities.penalises_products:
        return []
    return [row for shared in products(record, pairs) for row in _bounds(place, record.relaxation, shared)]


def _bounds(place: GeneratedBlock, relaxation: Any, shared: list[Product]) -> Iterator[Any]:
    shift = relaxation.shift(place.bound)
    if shift is not None:
        # The shift is the bound of the row and not a term of its body. So the body stays a plain product, which is
        # quicker to write, and delta moves inside a solve by moving one bound.
        residuals = [relaxation.residual(product.a, product.b, 0) for product in shared]
        body = residuals[0] if len(residuals) == 1 else quicksum(residuals)
        yield place.put_row("rows", body <= shift, _sources(shared))
        return
    # Residuals without a shift cannot be added up: each product is bounded by itself.
    for product in shared:
        residual = relaxation.residual(product.a, product.b, place.bound)
        yield place.put_row("rows", residual <= 0, product.sources)


def _sources(row: list[Product]) -> list[Any]:
    if len(row) == 1:
        return row[0].sources
    found = {id(source): source for product in row for source in product.sources}
    return list(found.values())


def objective_with_penalty(record: RelaxationRecord) -> Objective:
    """The user's objective with the penalty term of all groups."""
    users, main = record.objective, record.main
    if record.abilities.penalises_products:
        formed = [product for group in record.groups for row in products(record, group.pairs) for product in row]
        # A factor of one is dropped by Pyomo itself.
        amount = quicksum([product.weight * (product.a * product.b) for product in formed])
    else:
        amount = main.excess
    term = record.relaxation.coefficient(main.delta) * amount
    if users is None:
        return Objective(expr=term, sense=minimize)
    term = in_units_of(term, users)
    # The user's objective enters by name: what is later assigned to it is followed.
    return Objective(expr=users + term if users.is_minimizing() else users - term, sense=users.sense)
