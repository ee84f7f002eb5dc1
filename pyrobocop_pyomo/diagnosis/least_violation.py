"""The least violation of a model's rows near a point, by linear programs, and which bounds, values and rows hold it."""

from __future__ import annotations

import enum
import math
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint

from pyrobocop_pyomo.complementarity import CanonicalPair, SidePart, pairs_of
from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.modeling.deadline import NO_DEADLINE, Deadline
from pyrobocop_pyomo.modeling.row_violations import largest_violation, number_or_nan
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.modeling.variable_values import put_values, values_restored, within_bounds
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.linear_programs import LinearProgram, LinearStatus
from pyrobocop_pyomo.numerics.rounding import MET
from pyrobocop_pyomo.optional_imports import scipy

from .linearised_rows import LinearisedRows
from .places import is_equation_of_a_phase, place_in_words, separation_of, time_of

# Each round differentiates every row. Models with more rows are left alone; with so many there are three rounds, which
# linear rows need at most. Time itself depends on what else runs.
MOST_ROWS, MOST_ROUNDS = 20_000, 40
MOST_SECONDS = 120.0
# A step that is predicted to take away a smaller share than this, per unit of its radius, is none.
STATIONARY = 1e-3
# A step is taken where it takes away at least this share of what is predicted.
SUFFICIENT = 0.1
# So many are named in a sentence.
SHOWN = 5
# Relaxing one of them may not be enough: its multiplier only says that the violation falls.
STANDS_AGAINST = "What stands against it, of which at least one must give way:"


class Obstructing(NamedTuple):
    """One bound, fixed value or row that has a multiplier.

    Attributes
    ----------
    data : component data
        A variable or a row.
    sign : str
        ``"<="``, ``">="``, or ``"="`` where it is fixed; empty for a row.
    value : float
        The bound, or the fixed value.
    influence : float
        By how much the least violation falls where it gives way by its own size.
    """

    data: Any
    sign: str
    value: float
    influence: float

    @property
    def group(self) -> Hashable:
        """What is named together: a separation, rows of a component, bounds of one side, or the same fixed values."""
        separation = None if self.sign else separation_of(self.data)
        return separation or (id(self.data.parent_component()), self.sign, self.value if self.sign == "=" else None)

    @property
    def is_of_a_pair(self) -> bool:
        """Whether it is a side of a pair, which has to be at zero."""
        return not self.sign and self.data.ctype in PAIR_TYPES


@dataclass(frozen=True)
class Obstruction:
    """The bounds of one side, fixed values or rows of one component.

    Attributes
    ----------
    name : str
        Of the component, or of its only data.
    words : str
        What it is, with its number and where in time.
    influence : float
        By how much the least violation falls where they give way by their own size, in sum.
    limit : str
        The sign and number of its bound, or its fixed value; empty for rows.
    """

    name: str
    words: str
    influence: float
    limit: str = ""

    @property
    def is_fixed(self) -> bool:
        """Whether it is a fixed value."""
        return self.limit.startswith("fixed")

    def __str__(self) -> str:
        return self.words


class StatedRow(NamedTuple):
    """One row: a constraint, or a side of a pair; a bound is None where there is none."""

    data: Any
    body: Any
    lower: float | None
    upper: float | None


def stated_rows(model: Any, pairs: Iterable[CanonicalPair] = ()) -> list[StatedRow]:
    """Active constraints that hold what may move, and sides of pairs: the side that is at zero stays there.

    Where both sides are, each may leave zero, so that what no step mends then is not mended on any branch either.

    Parameters
    ----------
    model : Block
        With the values of the point in question.
    pairs : iterable of CanonicalPair
        Those of which only parts of the sides belong to the pair are left out.
    """
    found = []
    for row in model.component_data_objects(Constraint, active=True, descend_into=Block):
        lower, body, upper = row.to_bounded_expression(True)
        if any(True for _ in variables_in(body, include_fixed=False)):
            found.append(StatedRow(row, body, lower, upper))
    for pair in pairs:
        if pair.a_part is SidePart.WHOLE is pair.b_part:
            sides = [number_or_nan(side) for side in (pair.a, pair.b)]
            at_zero = None if max(sides) <= MET else int(sides[1] < sides[0])
            for number, side in enumerate((pair.a, pair.b)):
                found.append(StatedRow(pair.source, side, 0.0, 0.0 if number == at_zero else None))
    return found


class ViolatedRows(LinearisedRows):
    """Rows at the values that are on the model, and below them the bounds and values that hold their variables.

    Parameters
    ----------
    rows : sequence of StatedRow
    weights : float array, shape (m,), optional
        Of the rows' violations; by default such that moving one variable by its size changes a row by at most one.

    Attributes
    ----------
    weights : float array, shape (m,)
    sizes : float array, shape (n,)
        Of the variables, the fixed ones among them.
    total : float
        Weighted violation of all rows, in sum.
    is_finite : bool
        Whether all rows have a value and derivatives, and none is too large to tell violations from rounding.
    """

    def __init__(self, rows: Sequence[StatedRow], weights: Array | None = None) -> None:
        super().__init__(rows, include_fixed=True)
        self._x = np.array([variable.value for variable in self.variables], dtype=float)
        fixed = np.array([variable.fixed for variable in self.variables], dtype=bool)
        bounds = [(v.value, v.value) if v.fixed else v.bounds for v in self.variables]
        lower, upper = np.array([*((row.lower, row.upper) for row in rows), *bounds], dtype=float).reshape(-1, 2).T
        jacobian = self.jacobian
        jacobian.data[np.isnan(jacobian.data) & fixed[jacobian.indices]] = 0.0
        here = np.concatenate([[number_or_nan(row.body) for row in rows], self._x])
        # Beside larger numbers rounding would be taken for a violation.
        self.is_finite = bool(np.isfinite(jacobian.data).all() and (np.spacing(np.abs(here)) <= MET).all())
        # From the value of each down to its lower and up to its upper bound.
        self._to_lower = np.where(np.isnan(lower), -np.inf, lower) - here
        self._to_upper = np.where(np.isnan(upper), np.inf, upper) - here
        m, n = jacobian.shape
        self._matrix = scipy.sparse.vstack([jacobian, scipy.sparse.identity(n)], format="csr")
        self._parts = [*(row.data for row in rows), *self.variables]
        width = self._to_upper[m:] - self._to_lower[m:]
        self.sizes = np.maximum(np.maximum(1.0, np.abs(self._x)), np.where(np.isfinite(width), width, 0.0))
        if weights is None:
            slopes = abs(jacobian @ scipy.sparse.diags(self.sizes * ~fixed)).max(axis=1).toarray().ravel()
            weights = 1.0 / np.where(slopes > 0, slopes, 1.0)
        self.weights = weights
        self.total = float(weights @ (np.maximum(self._to_lower[:m], 0.0) + np.maximum(-self._to_upper[:m], 0.0)))

    def step(self, radius: float, deadline: Deadline) -> tuple[Array, float, Array] | None:
        """The step within the bounds and a trust region, in sizes, after which the rows are violated least.

        Returns
        -------
        float array, shape (n,)
            Change of the variables.
        float
            Violation of the linearised rows after it, weighted, in sum.
        float array, shape (m + n,)
            By how much that grows per unit of the active bound of each row, and of each variable.
        """
        m, n = len(self.rows), self._x.size
        reach, slack = radius * self.sizes, scipy.sparse.identity(m + n, format="csr")[:, :m]
        program = LinearProgram(
            np.concatenate([np.zeros(n), self.weights, self.weights]),
            np.concatenate([-reach, np.zeros(2 * m)]),
            np.concatenate([reach, np.full(2 * m, np.inf)]),
            [(scipy.sparse.hstack([self._matrix, slack, -slack], format="csr"), self._to_lower, self._to_upper)],
        )
        answer = program.solve(deadline)
        return None if answer.x is None else (answer.x[:n], float(program.cost @ answer.x), answer.duals)

    def least_widening(self, parts: Iterable[Any], deadline: Deadline) -> float | None:
        """By how much bounds of some variables, or sides of some rows, have to give way for linear rows to be met.

        Parameters
        ----------
        parts : iterable of component data
        deadline : Deadline

        Returns
        -------
        float or None
            Infinite where that is not enough; None where the linear program did not end.
        """
        giving, n = set(map(id, parts)), self._x.size
        gives = [[float(id(part) in giving and not getattr(part, "fixed", False))] for part in self._parts]
        program = LinearProgram(
            np.append(np.zeros(n), 1.0),
            np.append(np.full(n, -np.inf), 0.0),
            np.full(n + 1, np.inf),
            [
                (scipy.sparse.hstack([self._matrix, gives], format="csr"), self._to_lower, np.inf),
                (scipy.sparse.hstack([self._matrix, np.negative(gives)], format="csr"), -np.inf, self._to_upper),
            ],
        )
        answer = program.solve(deadline)
        if answer.status is LinearStatus.INFEASIBLE:
            return math.inf
        return None if answer.x is None else float(answer.x[-1])

    def put(self, change: Array | float = 0.0) -> None:
        """Write the values to the model, changed within the bounds."""
        n = self._x.size
        put_values(self.variables, (self._x + np.clip(change, self._to_lower[-n:], self._to_upper[-n:])).tolist())

    def obstructing(self, multipliers: Array) -> Iterator[Obstructing]:
        """What has a multiplier: rows, bounds, and values that are fixed."""
        sides = {id(row.body) for row in self.rows if row.data.ctype in PAIR_TYPES}
        influences = np.abs(multipliers) * np.concatenate([1.0 / self.weights, self.sizes])
        for k in np.flatnonzero(influences > MET).tolist():
            part, influence = self._parts[k], float(influences[k])
            if k < len(self.rows):
                yield Obstructing(part, "", 0.0, influence)
            elif part.fixed:
                yield Obstructing(part, "=", float(part.value), influence)
            elif multipliers[k] < 0.0:
                yield Obstructing(part, "<=", float(part.ub), influence)
            elif part.lb != 0.0 or id(part) not in sides:
                yield Obstructing(part, ">=", float(part.lb), influence)


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
    relief : float or None
        How far the bounds or rows of the first of them have to give way for everything else to be met, by slopes where
        rows are nonlinear; infinite where it is not enough. None where it is not known, as of fixed values and pairs.
    """

    kind: Least
    has_pairs: bool
    total: float
    obstructions: tuple[Obstruction, ...] = ()
    relief: float | None = None

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

    def first_try(self, *, has_given_time: bool) -> str:
        """What to relax first, with all bounds of that component, and how far; empty where nothing is known of it.

        Parameters
        ----------
        has_given_time : bool
            Whether more time may help, too.
        """
        if not self.obstructions:
            return ""
        first = self.obstructions[0]
        far = "" if self.relief is None else self._how_far(self.relief)
        time = ", or give it more time" if has_given_time else ""
        if not first.limit or first.is_fixed:
            return f"Try first to {'change' if first.limit else 'relax'} {first}{far}{time}."
        same = (one for one in self.obstructions if one.name == first.name and not one.is_fixed)
        limits = [one.limit for one in same if one.limit]
        bounds = " and ".join(f"'{first.name}' {limit}" for limit in limits)
        return f"Try first to widen the bound{'s' if len(limits) > 1 else ''} {bounds}{far}{time}."

    def _how_far(self, amount: float) -> str:
        """A positive amount in words, with three digits that are not too small."""
        if math.isinf(amount):
            return ", which is not enough alone"
        unit = 10.0 ** (math.floor(math.log10(amount)) - 2)
        digits = f"{math.ceil(amount / unit * (1.0 - MET)) * unit:.3g}"
        return f" by {digits} or more" if self.is_proof else f" by about {digits}"

    def __str__(self) -> str:
        said = "With the same sides of its pairs at zero, no point nearby violates less."
        said = said if self.has_pairs else self.kind.value
        if not self.obstructions:
            return said
        left = len(self.obstructions) - SHOWN
        more = [f"  and {left} more"] if left > 0 else []
        named = [f"  {obstruction}" for obstruction in self.obstructions[:SHOWN]]
        return "\n".join([f"{said} {STANDS_AGAINST}", *named, *more])


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
        linear = [row for row in constraints if row.body.polynomial_degree() in (0, 1)] if at.is_finite else []
        if 0 < len(linear) < len(rows):
            with values_restored(free):
                found = _descended(ViolatedRows(linear), False, deadline)
            if found is not None and found.kind is Least.PROVEN:
                return found  # whatever pairs and nonlinear rows say
        found = _descended(at, bool(pairs), deadline)
    return None if found is None or (pairs and not found.obstructions) else found


def _impossible_pair(
    constraints: Sequence[StatedRow], pairs: Sequence[CanonicalPair], deadline: Deadline
) -> LeastViolation | None:
    """What keeps both sides of the worst pair from zero, whatever the other pairs; None where one side can be zero."""
    pair = max(pairs, key=lambda pair: min(number_or_nan(pair.a), number_or_nan(pair.b)))
    found: list[LeastViolation] = []
    for zero, other in ((pair.a, pair.b), (pair.b, pair.a)):
        sides = [StatedRow(pair.source, zero, 0.0, 0.0), StatedRow(pair.source, other, 0.0, None)]
        least = _descended(ViolatedRows([*constraints, *sides]), False, deadline)
        if least is None or not least.obstructions or not pair.a_part is SidePart.WHOLE is pair.b_part:
            return None
        found.append(least)
    found.sort(key=lambda least: math.inf if least.relief is None else least.relief)
    kind = Least.PROVEN if all(least.kind is Least.PROVEN for least in found) else Least.LOCAL
    against = {one.words: one for least in found for one in least.obstructions if one.name != pair.source.name}
    return LeastViolation(kind, False, min(least.total for least in found), tuple(against.values()), found[0].relief)


def _descended(at: ViolatedRows, has_pairs: bool, deadline: Deadline) -> LeastViolation | None:
    """Go down from the values on the model."""
    rows = at.rows
    # Pyomo finds a degree by evaluating what is fixed in a row, which may have no value.
    is_linear = at.is_finite and all(row.body.polynomial_degree() in (0, 1) for row in rows)
    radius = math.inf if is_linear else 1.0
    for _ in range(min(MOST_ROUNDS, 3 * MOST_ROWS // len(rows))):
        if deadline.has_passed or not at.is_finite:
            return None
        if at.total <= MET:
            return LeastViolation(Least.NONE, has_pairs, at.total)
        step = at.step(radius, deadline)
        if step is None:
            return None
        change, total, multipliers = step
        if at.total - total <= STATIONARY * min(radius, 1.0) * at.total:
            groups = grouped(at.obstructing(multipliers))
            relief = _relief(at, *groups[0], deadline) if groups else None
            if not is_linear and relief == math.inf:
                relief = None  # further away than slopes are good for, it may be enough
            kind = Least.PROVEN if is_linear else Least.LOCAL
            return LeastViolation(kind, has_pairs, total, tuple(one for one, _ in groups), relief)
        at.put(change)
        after = ViolatedRows(rows, at.weights)
        if after.is_finite and at.total - after.total >= SUFFICIENT * (at.total - total):
            at, radius = after, 2.0 * radius
        else:
            at.put()
            radius = 0.25 * min(radius, float(np.abs(change / at.sizes).max(initial=0.0)))
    return LeastViolation(Least.UNKNOWN, has_pairs, at.total)


def _relief(
    at: ViolatedRows, obstruction: Obstruction, group: Sequence[Obstructing], deadline: Deadline
) -> float | None:
    """How far an obstruction has to give way alone, by the slopes here; None for fixed values and pairs."""
    first, component = group[0], group[0].data.parent_component()
    if obstruction.is_fixed or first.is_of_a_pair:
        return None
    is_whole = bool(first.sign) and obstruction.name == component.name
    amount = at.least_widening(component.values() if is_whole else [one.data for one in group], deadline)
    return None if amount is None or amount <= MET else amount


def grouped(obstructing: Iterable[Obstructing]) -> list[tuple[Obstruction, list[Obstructing]]]:
    """Obstructions by component and side: bounds, rows, pairs, fixed values, the most influential of each first.

    Equations of phases carry what is required at one time to the next: they are left out wherever there is anything
    else.
    """
    groups: dict[Hashable, list[Obstructing]] = {}
    for one in obstructing:
        groups.setdefault(one.group, []).append(one)
    stated = [some for some in groups.values() if some[0].sign or not is_equation_of_a_phase(some[0].data)]

    def rank(some: list[Obstructing]) -> tuple[bool, bool, bool, float]:
        # A bound is a number that can be widened. Ends are fixed, and contact is stated, in almost every problem.
        first = some[0]
        return first.sign == "=", first.is_of_a_pair, not first.sign, -sum(one.influence for one in some)

    return [(_obstruction(some), some) for some in sorted(stated or groups.values(), key=rank)]


def _obstruction(some: list[Obstructing]) -> Obstruction:
    influence, first, component = sum(one.influence for one in some), some[0], some[0].data.parent_component()
    times = [time for time in (time_of(one.data) for one in some) if time is not None]
    at_times = _span(times) if times else ""
    if not first.sign and (separation := separation_of(first.data)) is not None:
        block, one_shape, other_shape = separation
        words = f"the clearance between '{one_shape}' and '{other_shape}' of '{block}' {at_times}"
        return Obstruction(block, words, influence)
    if len(some) == 1 and not first.sign:
        return Obstruction(first.data.name, place_in_words(first.data), influence)
    name = first.data.name if len(some) == 1 else component.name
    kind = "" if first.sign else "pairs of " if first.is_of_a_pair else "constraint "
    values = [one.value for one in some]
    limit = f"{'fixed at' if first.sign == '=' else first.sign} {min(values):.6g}" if first.sign else ""
    if min(values) != max(values):
        limit += f" .. {max(values):.6g}"
    words = f"{kind}'{component.name if times else name}'"
    several = f"at {len(some)} of {len(component)} {'points,' if times else 'indices'}" if len(some) > 1 else ""
    return Obstruction(name, " ".join(filter(None, [words, limit, several, at_times])), influence, limit)


def _span(times: list[float]) -> str:
    first, last = min(times), max(times)
    return f"at t = {first:g}" if first == last else f"t = {first:g} to {last:g}"
