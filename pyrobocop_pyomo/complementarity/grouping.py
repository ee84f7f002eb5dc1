"""Which products share a bound: each pair its own, or all pairs of one element together."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from pyrobocop_pyomo.errors import ComplementarityError

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


@dataclass(frozen=True)
class PerPhase:
    """The products of one block share a bound: of a phase, all its pairs at all times.

    A phase is a block, and so is whatever else declares pairs: what counts is the block that a `Complementarity`
    component was put on. Pairs of a block within a phase share a bound of their own.
    """

    def groups(self, pairs: Sequence[CanonicalPair]) -> list[tuple[Hashable | None, list[CanonicalPair]]]:
        """One group per block, in the order of the first pair of each."""
        blocks: dict[int, Any] = {}
        found: dict[int, list[CanonicalPair]] = {}
        for pair in pairs:
            block = pair.source.parent_block()
            blocks[id(block)] = block
            found.setdefault(id(block), []).append(pair)
        return [(f"block {blocks[key].name}", members) for key, members in found.items()]


@dataclass(frozen=True)
class AllPairs:
    """All products share one bound: ``sum_l a_l * b_l <= delta``. One dense row couples the whole model."""

    def groups(self, pairs: Sequence[CanonicalPair]) -> list[tuple[Hashable | None, list[CanonicalPair]]]:
        """One group."""
        return [("all", list(pairs))] if pairs else []


@dataclass(frozen=True)
class Crossed:
    """Every a of an element is complementary to every b of it: products ``a_i * b_j`` over its stages i and j.

    With several stages per element it keeps switches from happening inside an element: a side that is positive at
    one stage has a partner that is zero at all of them. An element is what carries the same group label in the same
    `Complementarity` component; pairs without a label are elements of their own. The sides of a component are
    taken as they are declared: the first ones with the second ones. A relaxation that fixes products bounds them
    here, unless there is one row for the element: if all products were equal, all sides would be.

    Attributes
    ----------
    summed : {"none", "stage", "element"}
        How the products of an element share bounds: ``a_i * b_j <= delta`` for all i and j;
        ``a_i * sum_j b_j <= delta`` for each i; or one ``(sum_i a_i) * (sum_j b_j) <= delta``.

    References
    ----------
    Nurkanovic, Sperl, Albrecht & Diehl (2024), Finite elements with switch detection for direct optimal control of
    nonsmooth systems, sec. 3, doi:10.1007/s00211-024-01412-z
    """

    summed: str = "none"

    def __post_init__(self) -> None:
        """Refuse an unknown way to sum."""
        if self.summed not in ("none", "stage", "element"):
            raise ComplementarityError(f"{self}: summed is 'none', 'stage' or 'element'.")

    def groups(self, pairs: Sequence[CanonicalPair]) -> list[tuple[Hashable | None, list[CanonicalPair]]]:
        """One group per component, label and role, in the order of the first pair of each."""
        found: dict[Hashable, list[CanonicalPair]] = {}
        names: dict[int, str] = {}
        for pair in pairs:
            component = pair.source.parent_component()
            name = names.get(id(component))
            if name is None:
                name = names[id(component)] = component.name
            label = ("index", pair.source.index()) if pair.group is None else ("group", pair.group)
            found.setdefault((name, label, pair.role), []).append(pair)
        return list(found.items())

    def products(
        self, pairs: Sequence[CanonicalPair]
    ) -> list[list[tuple[Sequence[CanonicalPair], Sequence[CanonicalPair]]]]:
        """The products of an element; each has a bound of its own."""
        if self.summed == "none":
            return [[([a], [b])] for a in pairs for b in pairs]
        if self.summed == "stage":
            return [[([a], pairs)] for a in pairs]
        return [[(pairs, pairs)]]


GROUPINGS: dict[str, type] = {
    "pair": PerPair,
    "element": PerElement,
    "phase": PerPhase,
    "all": AllPairs,
    "crossed": Crossed,
}


def as_grouping(choice: str | Grouping) -> Grouping:
    """Turn a word such as "pair" or "element", or a grouping object, into the object.

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
