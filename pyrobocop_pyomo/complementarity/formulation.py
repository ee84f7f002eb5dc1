"""What a group of pairs becomes: its products, and the rows that bound them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from pyomo.core import quicksum

from pyrobocop_pyomo.errors import ComplementarityError

from .generated import GeneratedBlock
from .record import Group, Record, RelaxedPair

# Of the even share of delta: a product's own share never falls below, since some relaxations are not smooth at zero.
SMALLEST_SHARE = 1e-3


class Product(NamedTuple):
    """A product of (sums of) sides, ``(sum_i a_i) * (sum_j b_j)``; nearly always of the two sides of one pair."""

    a_pairs: Sequence[RelaxedPair]
    b_pairs: Sequence[RelaxedPair]

    @property
    def a(self) -> Any:
        """First factor."""
        return self.a_pairs[0].a if len(self.a_pairs) == 1 else quicksum([each.a for each in self.a_pairs])

    @property
    def b(self) -> Any:
        """Second factor."""
        return self.b_pairs[0].b if len(self.b_pairs) == 1 else quicksum([each.b for each in self.b_pairs])

    @property
    def weight(self) -> Any:
        """That of the pair; of several, their mean."""
        if self.a_pairs is self.b_pairs and len(self.a_pairs) == 1:
            return self.a_pairs[0].pair.weight
        pairs = [*self.a_pairs, *self.b_pairs]
        return quicksum([each.pair.weight for each in pairs]) / len(pairs)

    @property
    def sources(self) -> list[Any]:
        """The statements that it came from, each once."""
        if self.a_pairs is self.b_pairs and len(self.a_pairs) == 1:
            return [self.a_pairs[0].pair.source]
        found = {id(each.pair.source): each.pair.source for each in (*self.a_pairs, *self.b_pairs)}
        return list(found.values())


@dataclass(eq=False, slots=True)
class Formulation:
    """What a group needs: expressions of rows with their sources, and what is not yet in any component."""

    place: GeneratedBlock
    group: Group
    pairs: Sequence[RelaxedPair]
    rows: list[tuple[Any, list[Any]]] = field(default_factory=list)
    shares: list[Any] = field(default_factory=list)
    share_bounds: list[Any] = field(default_factory=list)
    budgets: list[tuple[Any, list[Any]]] = field(default_factory=list)
    states: list[Any] = field(default_factory=list)


def products(record: Record, pairs: Sequence[RelaxedPair]) -> list[list[Product]]:
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


def crossings(record: Record, pairs: Sequence[RelaxedPair]) -> list[tuple[RelaxedPair, RelaxedPair]]:
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


def formulate(place: GeneratedBlock, group: Group, pairs: Sequence[RelaxedPair]) -> Formulation:
    """Say what the rows of a group are, once it has these pairs; nothing is added to the model yet."""
    made = Formulation(place, group, pairs)
    record = place.record
    abilities = record.abilities
    formed = products(record, pairs)
    if abilities.penalises_products:
        if abilities.keeps_multipliers:
            made.states = _states(place, group, sum(map(len, formed)), 0.0)
        return made
    if abilities.keeps_bounds:
        made.states = _states(place, group, len(formed), record.main.delta.value)
        bounds: Sequence[Any] = made.states
    else:
        bounds = [place.bound] * len(formed)
    equality = abilities.equality and not _crosses(formed)
    for row, bound in zip(formed, bounds, strict=True):
        _bound_row(made, row, bound, equality)
    return made


def _bound_row(made: Formulation, row: list[Product], bound: Any, equality: bool) -> None:
    record = made.place.record
    relaxation, abilities = record.relaxation, record.abilities
    shift = relaxation.shift(bound)
    if shift is not None and not abilities.several_rows:
        # The shift is the row's bound and not a term of its body: the body stays a plain product, which is
        # quicker to write, and whoever moves delta inside a solve moves one bound.
        residuals = [relaxation.residual(product.a, product.b, 0) for product in row]
        body = residuals[0] if len(residuals) == 1 else quicksum(residuals)
        expression = body == shift if equality else body <= shift
        made.rows.append((expression, _sources(row)))
        return
    if len(row) == 1:
        shares = [bound]
    else:
        # Residuals of this kind cannot be added up. Each product gets a share of delta instead; where a residual is
        # just the product, eliminating the shares gives the sum of the products again.
        lower = SMALLEST_SHARE / len(row) * bound
        kept = made.group.shares[len(made.shares) : len(made.shares) + len(row)]
        start = record.main.delta.value / len(row)
        shares = [*kept, *(made.place.new_variable("shares", None, start) for _ in range(len(row) - len(kept)))]
        made.shares += shares
        made.share_bounds += [lower] * len(row)
        made.budgets.append((quicksum(shares) <= bound, _sources(row)))
    for product, share in zip(row, shares, strict=True):
        a, b = product.a, product.b
        residual = relaxation.residual(a, b, share)
        made.rows.append((residual == 0 if equality else residual <= 0, product.sources))
        if abilities.several_rows:
            further = relaxation.further_residuals(a, b, share)
            made.rows += [(each <= 0, product.sources) for each in further]


def _crosses(formed: list[list[Product]]) -> bool:
    """Whether a side is in several products: fixing them all would make sides equal to each other."""
    formed_products = [product for row in formed for product in row]
    return any(
        len({id(pair) for pair in sides}) < len(sides)
        for sides in (
            [pair for product in formed_products for pair in product.a_pairs],
            [pair for product in formed_products for pair in product.b_pairs],
        )
    )


def _states(place: GeneratedBlock, group: Group, count: int, start: float) -> list[Any]:
    kept = group.states[:count]
    return [*kept, *(place.new_state(start) for _ in range(count - len(kept)))]


def _sources(row: list[Product]) -> list[Any]:
    if len(row) == 1:
        return row[0].sources
    found = {id(source): source for product in row for source in product.sources}
    return list(found.values())
