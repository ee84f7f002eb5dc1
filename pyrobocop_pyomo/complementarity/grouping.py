"""Which products share a bound: each pair its own, or all pairs of one element together."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from .canonical import CanonicalPair


@runtime_checkable
class Grouping(Protocol):
    """What decides which pairs are relaxed together, and which products they form.

    One further member is optional:

    ``products(pairs)``
        The products of one group as a list of lists: products of one inner list share a bound. A product is a tuple
        (pairs of the first factor, pairs of the second): it is the sum of the a of the former times the sum of the
        b of the latter. By default each pair is a product, and all of them share one bound.
    """

    def groups(self, pairs: Sequence[CanonicalPair]) -> list[tuple[Hashable | None, list[CanonicalPair]]]:
        """Split the pairs; every pair comes once, and equal pairs always get the same name.

        Pairs that are relaxed later join the group of their name; a group without a name (None) stays as it is.
        """
        ...


@dataclass(frozen=True)
class PerPair:
    """Each product has a row of its own: ``a_l * b_l <= delta`` for each pair l."""

    def groups(self, pairs: Sequence[CanonicalPair]) -> list[tuple[Hashable | None, list[CanonicalPair]]]:
        """One group per pair, which none joins."""
        return [(None, [pair]) for pair in pairs]


@dataclass(frozen=True)
class PerElement:
    """The products of one element share a row: ``sum_l a_l * b_l <= delta``.

    The sum is bounded by delta itself and not by a multiple that grows with the number of pairs, so the bound
    on a single product is never looser than with `PerPair`.

    An element is what carries the same group label in the same block. A pair without a label belongs with the
    other unlabelled pairs of its block that have its index: in a block that is indexed by time, all pairs of
    that time.

    References
    ----------
    Raghunathan, Jha & Romeres (2022), PyRoboCOP, doi:10.48550/arXiv.2203.10013
    """

    def groups(self, pairs: Sequence[CanonicalPair]) -> list[tuple[Hashable | None, list[CanonicalPair]]]:
        """One group per block and label, in the order of the first pair of each."""
        found: dict[str, list[CanonicalPair]] = {}
        block_names: dict[int, str] = {}
        for pair in pairs:
            block = pair.source.parent_block()
            block_name = block_names.get(id(block))
            if block_name is None:
                block_name = block_names[id(block)] = block.name
            # A label and an index may be equal numbers and yet mean different things: keep them apart.
            label = f"index {pair.source.index()!r}" if pair.group is None else f"group {pair.group!r}"
            found.setdefault(f"{block_name}, {label}", []).append(pair)
        return list(found.items())


GROUPINGS: dict[str, type] = {"pair": PerPair, "element": PerElement}


def as_grouping(choice: str | Grouping) -> Grouping:
    """Turn "pair", "element" or a grouping object into the object.

    Raises
    ------
    ValueError
        If it is neither a known word nor an object with a method ``groups(pairs)``.
    """
    if isinstance(choice, str):
        if choice not in GROUPINGS:
            raise ValueError(f"unknown grouping {choice!r}. Known: {', '.join(map(repr, GROUPINGS))}.")
        return GROUPINGS[choice]()
    if isinstance(choice, type) or not isinstance(choice, Grouping):
        raise ValueError(f"{choice!r} is no grouping: it needs a method groups(pairs). Pass an object or a word.")
    return choice
