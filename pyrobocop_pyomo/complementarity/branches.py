"""What a statement says as a choice: as disjuncts, or as special ordered sets of which one variable may be nonzero."""

from __future__ import annotations

from typing import Any

from pyomo.core import Any as AnyIndex
from pyomo.core import Block, Constraint, NonNegativeIntegers, SOSConstraint
from pyomo.gdp import Disjunct, Disjunction

from .bounded_sides import BoundedSides
from .canonical import CanonicalForm, CanonicalPair

BRANCHES_OF_A_RANGE = ("lower", "upper", "between")
BRANCHES_OF_A_PAIR = ("first", "second")


def add_disjunctions(block: Block, sides: BoundedSides, forms: list[CanonicalForm]) -> list[tuple[Any, Any]]:
    """Build ``[a == 0] v [b == 0]`` for each pair; returns every disjunct and disjunction with its source."""
    block.disjuncts = Disjunct(AnyIndex)
    block.choices = Disjunction(NonNegativeIntegers)
    generated = []
    for position, form in enumerate(form for form in forms if form.pairs):
        branches = _branches_of_range(form, sides) if form.between else _branches_of_pair(form.pairs[0], sides)
        chosen = []
        for branch, rows in branches.items():
            disjunct = block.disjuncts[position, branch]
            disjunct.rows = Constraint(range(len(rows)))
            for number, row in enumerate(rows):
                disjunct.rows[number] = row
            chosen.append(disjunct)
            generated.append((disjunct, form.source))
        block.choices[position] = chosen
        generated.append((block.choices[position], form.source))
    return generated


def _branches_of_pair(pair: CanonicalPair, sides: BoundedSides) -> dict[str, list[Any]]:
    variables = sides.nonnegative(pair.a, pair.source), sides.nonnegative(pair.b, pair.source)
    return {branch: [variable == 0] for branch, variable in zip(BRANCHES_OF_A_PAIR, variables, strict=True)}


def _branches_of_range(form: CanonicalForm, sides: BoundedSides) -> dict[str, list[Any]]:
    assert form.between is not None
    lower, body, upper = form.between
    inside = sides.between(body, lower, upper, form.source)
    free = sides.free(form.pairs[0].b, form.source)
    rows: list[list[Any]] = [[inside == lower, free >= 0], [inside == upper, free <= 0], [free == 0]]
    return dict(zip(BRANCHES_OF_A_RANGE, rows, strict=True))


def add_special_ordered_sets(block: Block, sides: BoundedSides, forms: list[CanonicalForm]) -> list[tuple[Any, Any]]:
    """Build a set {a, b} of type one for each pair, of a range one for either bound; returns sets with sources."""
    members: list[tuple[Any, Any]] = []
    for form in forms:
        if form.between:
            positive, negative = sides.parts(form.pairs[0].b, form.source)
            width = form.between[2] - form.between[0]
            for pair, part in zip(form.pairs, (positive, negative), strict=True):
                members.append((form.source, [sides.between(pair.a, 0, width, form.source), part]))
        else:
            members += [
                (form.source, [sides.nonnegative(pair.a, form.source), sides.nonnegative(pair.b, form.source)])
                for pair in form.pairs
            ]
    block.sets = SOSConstraint(range(len(members)), rule=_Members([each for _, each in members]), sos=1)
    return [(block.sets[position], source) for position, (source, _) in enumerate(members)]


class _Members:
    """A rule that a pickled model can carry, as a function inside a function could not."""

    def __init__(self, members: list[list[Any]]) -> None:
        self._members = members

    def __call__(self, block: Any, index: int) -> tuple[list[Any], list[int]]:
        return self._members[index], [1, 2]
