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


def products(record: RelaxationRecord, pairs: Sequence[RelaxedPair]) -> list[list[Product]]:
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


def crossings(record: RelaxationRecord, pairs: Sequence[RelaxedPair]) -> list[Product]:
    """The products of sides of different pairs."""
    formed = (product for shared in products(record, pairs) for product in shared)
    return [product for product in formed if product.a_pair is not product.b_pair]


def rows_of_group(place: GeneratedBlock, pairs: Sequence[RelaxedPair]) -> list[Any]:
    """State the rows that bound the products of a group; none where these are in the penalty term."""
    record = place.record
    if record.penalises_products:
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
        yield place.put_row("rows", residual <= 0, _sources([product]))


def _sources(shared: list[Product]) -> list[Any]:
    """The statements that products came from, each once."""
    sources = [relaxed.pair.source for product in shared for relaxed in product]
    return list({id(source): source for source in sources}.values())


def objective_with_penalty(record: RelaxationRecord) -> Objective:
    """The user's objective with the penalty term of all groups."""
    users, main = record.objective, record.main
    if record.penalises_products:
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
