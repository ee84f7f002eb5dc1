"""A statement as a choice: disjuncts, or special ordered sets, whose sides are bounded variables.

A disjunct ``s == 0`` of a bounded variable s suits all reformulations: big-M reads its M off the bounds, the hull
disaggregates s alone and not the variables of the side, and a special ordered set is a list of variables.
"""

from __future__ import annotations

import math
from typing import Any

from pyomo.contrib.fbbt.expression_bounds_walker import ExpressionBoundsVisitor
from pyomo.core import Any as AnyIndex
from pyomo.core import Block, Constraint, NonNegativeIntegers, SOSConstraint, Var
from pyomo.core.expr.numvalue import native_numeric_types, value
from pyomo.gdp import Disjunct, Disjunction

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.modeling.expressions import is_plain_variable

from .canonical import CanonicalForm, CanonicalPair, SidePart


class BoundedSides:
    """The variables that stand for sides on one generated block.

    Parameters
    ----------
    block : Block
        Generated, and not yet a part of the model; gets ``sides`` and ``rows``.
    default_bound : float or None
        Taken where no finite bound can be derived.
    bounds_needed : bool
        Whether an infinite bound is refused.
    """

    def __init__(self, block: Block, default_bound: float | None, bounds_needed: bool) -> None:
        block.sides = Var(NonNegativeIntegers, dense=False)
        block.rows = Constraint(NonNegativeIntegers)
        self._block = block
        self._default = default_bound
        self._needed = bounds_needed
        self._visitor = ExpressionBoundsVisitor(use_fixed_var_values_as_bounds=False)
        self.generated: list[tuple[Any, Any]] = []

    def add_row(self, source: Any, row: Any) -> None:
        """Add a row of a statement."""
        position = len(self._block.rows)
        self._block.rows[position] = row
        self.generated.append((self._block.rows[position], source))

    def nonnegative(self, side: Any, source: Any) -> Any:
        """Return a variable that equals the side and is at least 0."""
        upper = self._end(side, "upper", source)
        if upper is not None and upper < 0:
            raise ComplementarityError(
                f"'{source.name}': the side '{side}' is at most {upper:g} by the bounds of its variables, and has to "
                "be nonnegative. Correct the bounds."
            )
        return self.between(side, 0, upper, source)

    def free(self, side: Any, source: Any) -> Any:
        """Return a variable that equals the side and has bounds that do not cut anything off."""
        return self.between(side, self._end(side, "lower", source), self._end(side, "upper", source), source)

    def parts(self, side: Any, source: Any) -> tuple[Any, Any]:
        """Return two nonnegative variables, of which the side is the difference."""
        lower, upper = self._end(side, "lower", source), self._end(side, "upper", source)
        number = value(side, exception=False)
        positive = self._new(0, None if upper is None else max(upper, 0), number, source)
        negative = self._new(0, None if lower is None else max(-lower, 0), None if number is None else -number, source)
        self.add_row(source, positive - negative == side)
        return positive, negative

    def between(self, side: Any, lower: Any, upper: Any, source: Any) -> Any:
        """Return a variable that equals the side and has these bounds; it may be the side itself."""
        if is_plain_variable(side) and _reaches(side.lower, lower, 1) and _reaches(side.upper, upper, -1):
            return side
        variable = self._new(lower, upper, value(side, exception=False), source)
        self.add_row(source, variable == side)
        return variable

    def _new(self, lower: Any, upper: Any, number: float | None, source: Any) -> Any:
        variable = self._block.sides.add(len(self._block.sides))
        variable.setlb(lower)
        variable.setub(upper)
        if number is not None:
            for bound, nearer in ((variable.lb, max), (variable.ub, min)):
                number = number if bound is None else nearer(number, bound)
            variable.set_value(number)
        self.generated.append((variable, source))
        return variable

    def _end(self, side: Any, which: str, source: Any) -> float | None:
        """The bound of a side by interval arithmetic, at the present values of the parameters."""
        lower, upper = self._visitor.walk_expression(side)
        end = lower if which == "lower" else upper
        if math.isfinite(end):
            return end
        if self._default is not None:
            return -self._default if which == "lower" else self._default
        if self._needed:
            raise ComplementarityError(
                f"'{source.name}': no finite {which} bound follows for the side '{side}' from the bounds of its "
                "variables, and the disjunctive form needs one. Bound the variables, or pass default_bound=, which "
                "becomes a bound of such sides, or sos1=True."
            )
        return None


def _reaches(own: Any, wanted: Any, sign: int) -> bool:
    """Whether a variable's own bound is as tight as the wanted one, now and later."""
    if wanted is None or own is wanted:
        return True
    if own.__class__ not in native_numeric_types or wanted.__class__ not in native_numeric_types:
        return False
    return sign * own >= sign * wanted


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
    # The parts of a free side are zero together.
    second = sides.nonnegative if pair.b_part is SidePart.WHOLE else sides.free
    variables = sides.nonnegative(pair.a, pair.source), second(pair.b, pair.source)
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
        elif len(form.pairs) > 1:
            first = sides.nonnegative(form.pairs[0].a, form.source)
            positive, negative = sides.parts(form.pairs[0].b, form.source)
            members += [(form.source, [first, positive]), (form.source, [first, negative])]
            members.append((form.source, [positive, negative]))
        else:
            members += [
                (form.source, [sides.nonnegative(pair.a, form.source), sides.nonnegative(pair.b, form.source)])
                for pair in form.pairs
            ]
    block.sets = SOSConstraint(range(len(members)), rule=_Members([variables for _, variables in members]), sos=1)
    return [(block.sets[position], source) for position, (source, _) in enumerate(members)]


class _Members:
    """A rule that a pickled model can carry, as a function inside a function could not."""

    def __init__(self, members: list[list[Any]]) -> None:
        self._members = members

    def __call__(self, block: Any, index: int) -> tuple[list[Any], list[int]]:
        return self._members[index], [1, 2]
