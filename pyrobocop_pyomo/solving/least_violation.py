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
from pyrobocop_pyomo.diagnosis.linearised_rows import LinearisedRows, gradient
from pyrobocop_pyomo.diagnosis.places import is_equation_of_a_phase, place_in_words, separation_of, time_of
from pyrobocop_pyomo.modeling.deadline import NO_DEADLINE, Deadline
from pyrobocop_pyomo.modeling.row_violations import largest_violation, number_or_nan
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.modeling.variable_values import put_values, values_restored, within_bounds
from pyrobocop_pyomo.mpcc.linear_programs import LinearProgram, LinearStatus
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray

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
# What linear programs leave of zero: of violations and their sums, of sides and distances from bounds in their sizes,
# and of multipliers beside the largest possible one.
MET = 1e-6
# Relaxing one of them may not be enough: its multiplier only says that the violation falls.
STANDS_AGAINST = "What stands against it, of which at least one must give way:"


class ObstructingData(NamedTuple):
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


@dataclass(frozen=True)
class Relief:
    """How far the bounds or rows of one component have to give way for everything else to be met.

    Attributes
    ----------
    name : str
        Of the obstruction.
    amount : float
        In its units; infinite where it is not enough, however far it gives way.
    """

    name: str
    amount: float


class LinearStep(NamedTuple):
    """What a linear program finds.

    Attributes
    ----------
    change : float array, shape (n,)
        Of the variables.
    length : float
        The largest change, in sizes.
    total : float
        Violation of the linearised rows after it, weighted, in sum.
    row_multipliers : float array, shape (m,)
        By how much that grows per unit of a row's active bound.
    """

    change: FloatArray
    length: float
    total: float
    row_multipliers: FloatArray


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
    """Rows at the values that are on the model.

    Parameters
    ----------
    rows : sequence of StatedRow
    weights : float array, shape (m,), optional
        Of the rows' violations; by default such that moving one variable by its size changes a row by at most one.

    Attributes
    ----------
    weights : float array, shape (m,)
    total : float
        Weighted violation of all rows, in sum.
    is_finite : bool
        Whether all rows have a value and derivatives.
    """

    def __init__(self, rows: Sequence[StatedRow], weights: FloatArray | None = None) -> None:
        super().__init__(rows)
        self._x = np.array([variable.value for variable in self.variables], dtype=float)
        bounds = np.array([variable.bounds for variable in self.variables], dtype=float).reshape(-1, 2)
        self._lower = np.where(np.isnan(bounds[:, 0]), -np.inf, bounds[:, 0])
        self._upper = np.where(np.isnan(bounds[:, 1]), np.inf, bounds[:, 1])
        width = self._upper - self._lower
        self._sizes = np.maximum(np.maximum(1.0, np.abs(self._x)), np.where(np.isfinite(width), width, 0.0))
        values = np.array([number_or_nan(row.body) for row in rows])
        values[np.isinf(values)] = np.nan
        # From each row's value down to its lower and up to its upper bound.
        self._to_lower = np.array([-np.inf if row.lower is None else row.lower for row in rows]) - values
        self._to_upper = np.array([np.inf if row.upper is None else row.upper for row in rows]) - values
        self.is_finite = bool(np.isfinite(values).all() and np.isfinite(self.jacobian.data).all())
        self.weights = self._own_weights() if weights is None else weights
        self.total = float(self.weights @ (np.maximum(self._to_lower, 0.0) + np.maximum(-self._to_upper, 0.0)))

    def _own_weights(self) -> FloatArray:
        sized = abs(self.jacobian @ scipy.sparse.diags(self._sizes)).tocoo()
        slopes = np.zeros(len(self.rows))
        np.fmax.at(slopes, sized.row, sized.data)
        return 1.0 / np.where(slopes > 0, slopes, 1.0)

    def step(self, radius: float, deadline: Deadline) -> LinearStep | None:
        """The step within the bounds and a trust region, in sizes, after which the rows are violated least."""
        m, n = self.jacobian.shape
        reach = radius * self._sizes if np.isfinite(radius) else np.full(n, np.inf)
        unit = scipy.sparse.identity(m, format="csr")
        below, above = np.isfinite(self._to_lower), np.isfinite(self._to_upper)
        program = LinearProgram(
            np.concatenate([np.zeros(n), self.weights, self.weights]),
            np.concatenate([np.maximum(self._lower - self._x, -reach), np.zeros(2 * m)]),
            np.concatenate(
                [np.minimum(self._upper - self._x, reach), np.where(below, np.inf, 0.0), np.where(above, np.inf, 0.0)]
            ),
            [(scipy.sparse.hstack([self.jacobian, unit, -unit], format="csr"), self._to_lower, self._to_upper)],
        )
        answer = program.solve_with_duals(deadline)
        if answer is None:
            return None
        point, multipliers = answer
        length = float(np.abs(point[:n] / self._sizes).max(initial=0.0))
        return LinearStep(point[:n], length, float(program.cost @ point), multipliers)

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
        giving = set(map(id, parts))
        moved = np.array([id(variable) in giving for variable in self.variables], dtype=bool)
        n, to_lower, to_upper = len(moved), self._lower - self._x, self._upper - self._x
        matrix = scipy.sparse.vstack([self.jacobian, scipy.sparse.identity(n, format="csr")[moved]])
        gives = np.array([[id(row.data) in giving] for row in self.rows] + [[True]] * int(moved.sum()), dtype=float)
        lower, upper = np.append(self._to_lower, to_lower[moved]), np.append(self._to_upper, to_upper[moved])
        program = LinearProgram(
            np.append(np.zeros(n), 1.0),
            np.append(np.where(moved, -np.inf, to_lower), 0.0),
            np.append(np.where(moved, np.inf, to_upper), np.inf),
            [
                (scipy.sparse.hstack([matrix, gives], format="csr"), lower, np.inf),
                (scipy.sparse.hstack([matrix, -gives], format="csr"), -np.inf, upper),
            ],
        )
        answer = program.solve(deadline)
        if answer.status is LinearStatus.INFEASIBLE:
            return float("inf")
        return None if answer.x is None else float(answer.x[-1])

    def put(self, step: LinearStep | None = None) -> None:
        """Write the values to the model, after a step where there is one."""
        x = self._x if step is None else np.clip(self._x + step.change, self._lower, self._upper)
        put_values(self.variables, x.tolist())

    def obstructing(self, step: LinearStep) -> Iterator[ObstructingData]:
        """What has a multiplier: bounds, rows, and values that are fixed."""
        x, multipliers = self._x + step.change, step.row_multipliers
        sides = {id(row.body) for row in self.rows if row.data.parent_component().ctype in PAIR_TYPES}
        reduced = -(self.jacobian.T @ multipliers)
        for j in np.flatnonzero(np.abs(reduced) * self._sizes > MET):
            bound, sign = (self._lower[j], ">=") if reduced[j] > 0 else (self._upper[j], "<=")
            of_pair = sign == ">=" and bound == 0.0 and id(self.variables[j]) in sides
            if abs(x[j] - bound) <= MET * self._sizes[j] and not of_pair:
                yield ObstructingData(self.variables[j], sign, float(bound), float(abs(reduced[j]) * self._sizes[j]))
        fixed: dict[int, tuple[Any, float]] = {}
        for i in np.flatnonzero(np.abs(multipliers) > MET * self.weights).tolist():
            row = self.rows[i]
            yield ObstructingData(row.data, "", 0.0, float(abs(multipliers[i]) / self.weights[i]))
            for variable, slope in gradient(row.body, [v for v in variables_in(row.body) if v.fixed]):
                if np.isfinite(slope):
                    of_others = fixed.get(id(variable), (variable, 0.0))[1]
                    fixed[id(variable)] = variable, of_others + slope * multipliers[i]
        for variable, slope in fixed.values():
            influence = abs(slope) * max(1.0, abs(variable.value))
            if influence > MET:
                yield ObstructingData(variable, "=", float(variable.value), float(influence))


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

    def first_try(self, *, has_given_time: bool) -> str:
        """What to relax first, with all bounds of that component, and how far; empty where nothing is known of it.

        Parameters
        ----------
        has_given_time : bool
            Whether more time may help, too.
        """
        if not self.obstructions:
            return ""
        first, far = self.obstructions[0], ""
        if self.relief is not None:
            first = next(one for one in self.obstructions if one.name == self.relief.name and not one.is_fixed)
            far = self._how_far(self.relief.amount)
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
    for _ in range(min(MOST_ROUNDS, 3 * MOST_ROWS // len(rows))):
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


def grouped(data: Iterable[ObstructingData]) -> list[tuple[Obstruction, list[ObstructingData]]]:
    """Obstructions by component and side: bounds, rows, pairs, fixed values, the most influential of each first.

    Equations of phases carry what is required at one time to the next: they are left out wherever there is anything
    else.
    """
    groups: dict[Hashable, list[ObstructingData]] = {}
    for one in data:
        groups.setdefault(_label(one), []).append(one)
    stated = [some for some in groups.values() if some[0].sign or not is_equation_of_a_phase(some[0].data)]
    # A bound is a number that can be widened. Ends are fixed, and contact is stated, in almost every problem.
    ranked = [(_rank(some[0]), _obstruction(some), some) for some in stated or groups.values()]
    return [(one, some) for _, one, some in sorted(ranked, key=lambda each: (each[0], -each[1].influence))]


def _label(one: ObstructingData) -> Hashable:
    if not one.sign and (separation := separation_of(one.data)) is not None:
        return separation[:3]
    return id(one.data.parent_component()), one.sign, one.value if one.sign == "=" else None


def _rank(one: ObstructingData) -> int:
    if one.sign:
        return 3 if one.sign == "=" else 0
    return 2 if one.data.parent_component().ctype in PAIR_TYPES else 1


def _obstruction(some: list[ObstructingData]) -> Obstruction:
    influence, first, component = sum(one.influence for one in some), some[0], some[0].data.parent_component()
    separations = [] if first.sign else [found for one in some if (found := separation_of(one.data)) is not None]
    if separations:
        block, one_shape, other_shape, _ = separations[0]
        span = _span([start for *_, start in separations])
        return Obstruction(
            block, f"the clearance between '{one_shape}' and '{other_shape}' of '{block}' {span}", influence
        )
    if len(some) == 1 and not first.sign:
        return Obstruction(first.data.name, place_in_words(first.data), influence)
    times = [time for time in (time_of(one.data) for one in some) if time is not None]
    name = first.data.name if len(some) == 1 else component.name
    kind = "" if first.sign else "pairs of " if component.ctype in PAIR_TYPES else "constraint "
    limit = _bound(some) if first.sign else ""
    words = " ".join([f"{kind}'{component.name if times else name}'", *filter(None, [limit])])
    if len(some) > 1:
        words += f" at {len(some)} of {len(component)} {'points,' if times else 'indices'}"
    return Obstruction(name, f"{words} {_span(times)}" if times else words, influence, limit)


def _span(times: list[float]) -> str:
    first, last = min(times), max(times)
    return f"at t = {first:g}" if first == last else f"t = {first:g} to {last:g}"


def _bound(some: list[ObstructingData]) -> str:
    sign, values = some[0].sign, [one.value for one in some]
    least, most = min(values), max(values)
    return f"{'fixed at' if sign == '=' else sign} {least:.6g}" + ("" if least == most else f" .. {most:.6g}")
