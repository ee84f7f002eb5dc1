"""Which products share a bound: each has its own, or all products of an element have one."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import cache
from operator import attrgetter
from typing import Any, Protocol, runtime_checkable

from pyrobocop_pyomo.errors import ComplementarityError

from .forms import CanonicalPair


@runtime_checkable
class Grouping(Protocol):
    """Decides which pairs are relaxed together, and which products they form.

    One further member is optional:

    ``products(pairs)``
        The products of one group, each with a bound of its own, as tuples: a of the first pair times b of the second
        one. By default each pair is a product, and all of them share one bound.
    """

    def groups(self, pairs: Sequence[CanonicalPair]) -> list[tuple[Hashable | None, list[CanonicalPair]]]:
        """Split the pairs into named lists; every pair comes once."""


@dataclass(frozen=True)
class PerPair:
    """Each product has a row of its own: ``a_l * b_l <= delta`` for each pair l."""

    def groups(self, pairs: Sequence[CanonicalPair]) -> list[tuple[Hashable | None, list[CanonicalPair]]]:
        """One group per pair."""
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
        name = cache(attrgetter("name"))

        def label(pair: CanonicalPair) -> str:
            # A label and an index may be equal numbers and yet mean different things: keep them apart.
            own = f"index {pair.source.index()!r}" if pair.group is None else f"group {pair.group!r}"
            return f"{name(pair.source.parent_block())}, {own}"

        return _collected(pairs, label)


@dataclass(frozen=True)
class Crossed:
    """Every a of an element is complementary to every b of it: products ``a_i * b_j`` over its stages i and j.

    With several stages per element it keeps switches from happening inside an element: a side that is positive at
    one stage has a partner that is zero at all of them. Only pairs that state the same are crossed: those of one
    family in one `Complementarity` component. In a phase that is the pairs at one position (or with one key) of
    what the rule returns; elsewhere, the pairs whose indices differ in the first part alone, unless ``family=`` says
    otherwise. An element is what carries the same group label; pairs without a label are elements of their own. The
    sides are taken as they are declared: the first ones with the second ones.

    Attributes
    ----------
    left_end : {None, "first", "second"} or callable
        Which side, if any, counts at the left end of an element as well, or a function that tells which of a pair:
        its value at the last pair of the element
        before stands beside those of the element's own stages. It has to be the side that is continuous in time (a
        distance, not the force that jumps), and the last stage has to be the end of the element, as it is for Radau
        and Lobatto. So no element can begin on one side of a switch and end on the other, and with moving boundaries
        these are where the switches are. Elements are then numbered by their labels, one by one; one whose
        predecessor has no pair, as the first of a phase, has no left end.

    References
    ----------
    Nurkanovic, Sperl, Albrecht & Diehl (2024), Finite elements with switch detection for direct optimal control of
    nonsmooth systems, doi:10.1007/s00211-024-01412-z
    """

    left_end: str | Callable[[CanonicalPair], str | None] | None = None

    def __post_init__(self) -> None:
        """Refuse unknown values."""
        if not callable(self.left_end) and self.left_end not in (None, "first", "second"):
            raise ComplementarityError(f"{self}: left_end is None, 'first' or 'second'.")

    def groups(self, pairs: Sequence[CanonicalPair]) -> list[tuple[Hashable | None, list[CanonicalPair]]]:
        """One group per family, role and element, in the order of the first pair of each.

        With left ends, the elements of a family form one group, since their products overlap.
        """
        name = cache(attrgetter("name"))

        def family(pair: CanonicalPair) -> Hashable:
            if pair.group is None:
                key: tuple[Hashable, ...] = ("index", pair.source.index())
            elif self._left_end_of(pair) is None:
                key = ("group", pair.group, pair.source.family)
            else:
                self._check_number(pair)
                key = ("family", pair.source.family)
            return (name(pair.source.parent_component()), *key, pair.role)

        return _collected(pairs, family)

    def products(self, pairs: Sequence[CanonicalPair]) -> list[tuple[CanonicalPair, CanonicalPair]]:
        """The products of a family, element by element."""
        left_end = self._left_end_of(pairs[0])
        if left_end is None or pairs[0].group is None:
            return list(itertools.product(pairs, pairs))
        # Targets come in any order: back to the order in which the component has them.
        positions = {index: n for n, index in enumerate(pairs[0].source.parent_component().keys())}
        elements: dict[Any, list[CanonicalPair]] = {}
        for pair in sorted(pairs, key=lambda pair: positions[pair.source.index()]):
            elements.setdefault(pair.group, []).append(pair)
        found: list[tuple[CanonicalPair, CanonicalPair]] = []
        for number, members in elements.items():
            longer = [*elements.get(number - 1, [])[-1:], *members]
            found += itertools.product(*((longer, members) if left_end == "first" else (members, longer)))
        return found

    def _left_end_of(self, pair: CanonicalPair) -> str | None:
        return self.left_end(pair) if callable(self.left_end) else self.left_end

    def _check_number(self, pair: CanonicalPair) -> None:
        if not isinstance(pair.group, int):
            raise ComplementarityError(
                f"'{pair.name}': its group label is {pair.group!r}, and {self} looks for the element before by number. "
                "Number the elements, as phases do: group= gives 0, 1, 2, ..."
            )


def _collected(
    pairs: Sequence[CanonicalPair], key: Callable[[CanonicalPair], Hashable]
) -> list[tuple[Hashable | None, list[CanonicalPair]]]:
    """Pairs of one key together, in the order of the first pair of each."""
    found: dict[Hashable | None, list[CanonicalPair]] = {}
    for pair in pairs:
        found.setdefault(key(pair), []).append(pair)
    return list(found.items())


GROUPINGS: dict[str, type] = {"pair": PerPair, "element": PerElement, "crossed": Crossed}


def as_grouping(choice: str | Grouping) -> Grouping:
    """Return the grouping of a name such as "pair" or "element"; an object is returned as it is.

    Raises
    ------
    ValueError
        If it is neither a known name nor an object with a method ``groups(pairs)``.
    """
    if isinstance(choice, str):
        if choice not in GROUPINGS:
            raise ValueError(f"unknown grouping {choice!r}. Known: {', '.join(map(repr, GROUPINGS))}.")
        return GROUPINGS[choice]()
    if isinstance(choice, type) or not isinstance(choice, Grouping):
        raise ValueError(f"{choice!r} is not a grouping: it needs a method groups(pairs). Pass an object or a name.")
    return choice
