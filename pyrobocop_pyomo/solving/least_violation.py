"""The least violation of a model's rows near a point, by linear programs, and what holds it there."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pyomo.core.base.constraint import Constraint

from pyrobocop_pyomo.complementarity import CanonicalPair, SidePart, pairs_of
from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.modeling.deadline import NO_DEADLINE, Deadline
from pyrobocop_pyomo.modeling.row_violations import largest_violation, number_or_nan
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.modeling.variable_values import put_values, values_restored, within_bounds

from .obstructions import SHOWN, ObstructingData, Obstruction, Relief, grouped
from .violated_rows import StatedRow, ViolatedRows, stated_rows

# Larger models are left alone: each round differentiates every row.
MOST_ROWS = 20_000
MOST_ROUNDS = 40
# Rows times rounds, about three seconds; linear rows need three rounds at most. Time itself depends on what else runs.
MOST_WORK, LEAST_ROUNDS = 40_000, 3
MOST_SECONDS = 120.0
# A step that is predicted to take away a smaller share than this, per unit of its radius, is none.
STATIONARY = 1e-3
# A step is taken where it takes away at least this share of what is predicted.
SUFFICIENT = 0.1
# Relaxing one of them may not be enough: its multiplier only says that the violation falls.
STANDS_AGAINST = "What stands against it, of which at least one must give way:"
# Sums of violations below this are rounding: the rows can be met.
MET = 1e-6


class Least(enum.Enum):
    """What linear programs show of the violation near a point; the value is a sentence."""

    PROVEN = "Linear rows contradict each other: no values meet them together."
    LOCAL = "No point nearby violates less: linear programs find no step that does."
    UNKNOWN = "Points nearby violate less: the runs ended before the least violation."
    NONE = (
        "The rows can be met: linear programs lead from there to a point that meets them all. Another initial guess or "
        "more iterations may lead to a solution."
    )


@dataclass(frozen=True)
class LeastViolation:
    """Where the violation of all rows together is least, near a point.

    Attributes
    ----------
    kind : Least
    has_pairs : bool
        Whether pairs take part: then it is meant with the same sides at zero, and known only where something holds it.
    total : float
        What is left in sum, each row in its own measure: the most that moving one variable by its size changes it.
    obstructions : tuple of Obstruction
        Bounds, fixed values and rows whose relaxation would lessen it, those that matter most first; fixed values last.
    relief : Relief or None
        Of the first of them that is enough alone, by slopes where rows are nonlinear; of the first one where none is,
        if all rows are linear. None where it is not known.
    """

    kind: Least
    has_pairs: bool
    total: float
    obstructions: tuple[Obstruction, ...] = ()
    relief: Relief | None = None

    @property
    def is_proof(self) -> bool:
        """Whether no values at all meet the rows, whatever the sides of pairs."""
        return self.kind is Least.PROVEN and not self.has_pairs

    @property
    def in_short(self) -> str:
        """What is known of points nearby, as the end of a verdict."""
        kind = Least.LOCAL if self.kind is Least.PROVEN else self.kind
        said = kind.value.partition(":")[0]
        return said[0].lower() + said[1:]

    def __str__(self) -> str:
        first, *others = self.lines(indent="")
        return f"{first} {'; '.join(others)}." if others else first

    def lines(self, indent: str = "  ") -> list[str]:
        """What is known as sentences, then one obstruction per line."""
        said = "With the same sides of its pairs at zero, no point nearby violates less."
        said = said if self.has_pairs else self.kind.value
        if not self.obstructions:
            return [said]
        left = len(self.obstructions) - SHOWN
        more = [f"{indent}and {left} more"] if left > 0 else []
        named = [f"{indent}{obstruction}" for obstruction in self.obstructions[:SHOWN]]
        return [f"{said} {STANDS_AGAINST}", *named, *more]


def least_violation(model: Any, deadline: Deadline = NO_DEADLINE) -> LeastViolation | None:
    r"""Lessen the sum of all violations by linear programs, and read from their multipliers what stands against it.

    In each round the rows are linearised, and :math:`\sum_i w_i (p_i + q_i)` is minimised over steps within a trust
    region and within the bounds. The weights are the reciprocals of the rows' largest slopes. Values that are fixed
    take part by their multipliers only. The model's values are put back.

    Parameters
    ----------
    model : Block
        Of its pairs, the side that is at zero stays there. Where its linear constraints alone contradict each other, it
        is they that are told of.
    deadline : Deadline

    Returns
    -------
    LeastViolation or None
        None for models that are large, have rows without values or derivatives, or take longer than the deadline; with
        pairs also where nothing holds the rows with these sides at zero, since another side may be the cause.

    References
    ----------
    Fletcher & Sainz de la Maza, Nonlinear programming and nonsmooth optimization by successive linear programming,
    Math. Program. 43 (1989), 235-256, doi:10.1007/BF01582292
    """
    pairs = pairs_of(model)
    rows = stated_rows(model, pairs)
    if not 0 < len(rows) <= MOST_ROWS:
        return None
    constraints = [row for row in rows if row.data.ctype is Constraint]
    only_pairs = bool(pairs) and largest_violation(row.data for row in constraints) <= MET
    deadline = deadline.within(MOST_SECONDS)
    free = {id(v): v for row in rows for v in variables_in(row.body, include_fixed=False)}.values()
    with values_restored(free):
        put_values([*free], [within_bounds(number_or_nan(variable), variable) for variable in free])
        impossible = _impossible_pair(constraints, pairs, deadline) if only_pairs else None
        if impossible is not None:
            return impossible
        at = ViolatedRows(rows)
        with values_restored(free):
            contradiction = _contradiction(rows, deadline) if at.is_finite else None
        if contradiction is not None:
            return contradiction
        found = _descended(rows, bool(pairs), deadline, at)
    return None if found is None or (pairs and not found.obstructions) else found


def _impossible_pair(
    constraints: Sequence[StatedRow], pairs: Sequence[CanonicalPair], deadline: Deadline
) -> LeastViolation | None:
    """What keeps both sides of the worst pair from zero, whatever the other pairs; None where one side can be zero."""
    pair = max(pairs, key=lambda pair: min(number_or_nan(pair.a), number_or_nan(pair.b)))
    found: list[LeastViolation] = []
    for zero, other in ((pair.a, pair.b), (pair.b, pair.a)):
        sides = [StatedRow(pair.source, zero, 0.0, 0.0), StatedRow(pair.source, other, 0.0, None)]
        least = _descended([*constraints, *sides], False, deadline)
        if least is None or not least.obstructions or not pair.a_part is SidePart.WHOLE is pair.b_part:
            return None
        found.append(least)
    kind = Least.PROVEN if all(least.kind is Least.PROVEN for least in found) else Least.LOCAL
    against = {one.words: one for least in found for one in least.obstructions if one.name != pair.source.name}
    reliefs = [least.relief for least in found if least.relief is not None and least.relief.name != pair.source.name]
    least_relief = min(reliefs, key=lambda relief: relief.amount, default=None)
    return LeastViolation(kind, False, min(least.total for least in found), tuple(against.values()), least_relief)


def _contradiction(rows: Sequence[StatedRow], deadline: Deadline) -> LeastViolation | None:
    """The proof that the linear constraints contradict each other, whatever pairs and nonlinear rows say."""
    linear = [row for row in rows if row.data.ctype is Constraint and row.body.polynomial_degree() in (0, 1)]
    if not 0 < len(linear) < len(rows):
        return None
    found = _descended(linear, False, deadline)
    return found if found is not None and found.kind is Least.PROVEN else None


def _descended(
    rows: Sequence[StatedRow], has_pairs: bool, deadline: Deadline, at: ViolatedRows | None = None
) -> LeastViolation | None:
    """Go down from the values on the model; `at` are the rows there, where they are known already."""
    at = ViolatedRows(rows) if at is None else at
    # Pyomo finds a degree by evaluating what is fixed in a row, which may have no value.
    is_linear = at.is_finite and all(row.body.polynomial_degree() in (0, 1) for row in rows)
    radius = math.inf if is_linear else 1.0
    for _ in range(min(MOST_ROUNDS, max(LEAST_ROUNDS, MOST_WORK // len(rows)))):
        if deadline.has_passed or not at.is_finite:
            return None
        if at.total <= MET:
            return LeastViolation(Least.NONE, has_pairs, at.total)
        step = at.step(radius, deadline)
        if step is None:
            return None
        if at.total - step.total <= STATIONARY * min(radius, 1.0) * at.total:
            groups = grouped(at.obstructing(step))
            relief = _first_relief(at, groups, deadline)
            if not is_linear and relief is not None and math.isinf(relief.amount):
                relief = None  # further away than slopes are good for, it may be enough
            kind = Least.PROVEN if is_linear else Least.LOCAL
            return LeastViolation(kind, has_pairs, step.total, tuple(one for one, _ in groups), relief)
        at.put(step)
        after = ViolatedRows(rows, at.weights)
        if after.is_finite and at.total - after.total >= SUFFICIENT * (at.total - step.total):
            at, radius = after, 2.0 * radius
        else:
            at.put()
            radius = 0.25 * min(radius, step.length)
    return LeastViolation(Least.UNKNOWN, has_pairs, at.total)


def _first_relief(
    at: ViolatedRows, groups: Sequence[tuple[Obstruction, list[ObstructingData]]], deadline: Deadline
) -> Relief | None:
    """The first obstruction that is enough alone, by the slopes here; fixed values and pairs are not tried."""
    tried: list[Relief] = []
    for obstruction, data in groups[:SHOWN]:
        component = data[0].data.parent_component()
        if not obstruction.is_fixed and component.ctype not in PAIR_TYPES:
            is_whole = bool(obstruction.limit) and obstruction.name == component.name
            amount = at.least_widening(component.values() if is_whole else [one.data for one in data], deadline)
            if amount is None or amount <= MET:
                return None
            tried.append(Relief(obstruction.name, amount))
            if math.isfinite(amount):
                return tried[-1]
    return next(iter(tried), None)
