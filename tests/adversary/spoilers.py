"""What spoils a problem: one small function each, by the words of a user who made the mistake."""

import enum
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import wraps
from math import nan, pi
from typing import Any
from unittest import mock

import numpy as np
import pyomo.environ as pyo
from pyomo.core.expr.visitor import identify_variables

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity.statement import Complements
from pyrobocop_pyomo.phases import PhaseBlockData

from .models import Problem, Units, objective_of

Random = np.random.Generator
SECONDS = 20.0  # at most, for one solve; verdicts are to depend on no clock
KINDS = ("ode", "constraint", "complementarity", "integral")


class Law(enum.Enum):
    """What a right answer is; see the package."""

    SAME = "the answer of the unspoilt problem"
    STATED = "an answer of the problem that is stated"
    DOUBTED = "none"


def solved_with_defaults(model: Any) -> Any:
    """As a user solves it."""
    return rcp.solve(model, progress=False, time_limit=SECONDS)


@dataclass
class Spoilt:
    """A problem after it was spoilt.

    Attributes
    ----------
    model : ConcreteModel
    law : Law
    factor : float
        By what the objective of the unspoilt problem is to be multiplied.
    solve : callable
    """

    model: pyo.ConcreteModel
    law: Law
    factor: float = 1.0
    solve: Callable[[Any], Any] = solved_with_defaults


class NothingToSpoil(Exception):
    """The problem has nothing of that kind."""


Spoiler = Callable[[Problem, Random], Spoilt]


def in_place(law: Law, only: str = "") -> Callable[[Callable[[Any, Random], Any]], Spoiler]:
    """A change of a model, as a spoiler of problems; of those alone that have a word in their names."""

    def spoiler(change: Callable[[Any, Random], Any]) -> Spoiler:
        @wraps(change)
        def spoil(problem: Problem, random: Random) -> Spoilt:
            if only not in problem.name:
                raise NothingToSpoil
            m = problem.build()
            change(m, random)
            return Spoilt(m, law)

        return spoil

    return spoiler


# ---------------------------------------------------------------------------------------- the same problem


@in_place(Law.SAME)
def guess_far_away(m: Any, random: Random) -> None:
    """The initial guess is wrong by powers of ten."""
    by = 10.0 ** random.uniform(-4, 4)
    for v in _free(m):
        v.set_value((v.value or 0.0) * by + random.normal() * by, skip_validation=True)


def other_units(problem: Problem, random: Random) -> Spoilt:
    """Lengths, times and angles are written in other units, everywhere."""
    if problem.in_units is None:
        raise NothingToSpoil
    powers = 10.0 ** random.uniform(-4, 4, size=2)
    units = Units(*powers, radian=random.choice([1.0, 180 / pi]))
    m, dimension = problem.in_units(units)
    return Spoilt(m, Law.SAME, units.factor(dimension))


def scaled_objective(problem: Problem, random: Random) -> Spoilt:
    """The objective is in other units."""
    m, by = problem.build(), 10.0 ** random.uniform(-12, 12)
    objective = objective_of(m)
    objective.set_value(by * objective.expr)
    return Spoilt(m, Law.SAME, by)


def scaled_sides(problem: Problem, random: Random) -> Spoilt:
    """The sides of pairs are in other units."""
    first, second = 10.0 ** random.uniform(-6, 6, size=2)

    def scaled(pairs: Any) -> Any:
        if isinstance(pairs, list):
            return [scaled(pair) for pair in pairs]
        return Complements(_times(first, pairs.first), _times(second, pairs.second))

    with _rules(lambda kind, rule: lambda b, t: scaled(rule(b, t)), "complementarity") as asked:
        m = problem.build()
    if not asked:
        raise NothingToSpoil
    return Spoilt(m, Law.SAME)


@in_place(Law.SAME)
def scaled_row(m: Any, random: Random) -> None:
    """Rows of one component are multiplied by a number."""
    by = 10.0 ** random.uniform(-6, 6)
    for row in _one(random, list(m.component_objects(pyo.Constraint, active=True))).values():
        row.set_value(_bounded(_times_number(by, row.lower), by * row.body, _times_number(by, row.upper)))


def scaled_by_pyomo(problem: Problem, random: Random) -> Spoilt:
    """`core.scale_model` before the solve."""
    m = problem.build()
    m.scaling_factor = pyo.Suffix(direction=pyo.Suffix.EXPORT)
    for component in m.component_objects((pyo.Var, pyo.Constraint)):
        m.scaling_factor[component] = 10.0 ** random.uniform(-4, 4)
    rename = bool(random.integers(2))
    return Spoilt(pyo.TransformationFactory("core.scale_model").create_using(m, rename=rename), Law.SAME)


@in_place(Law.SAME)
def row_said_twice(m: Any, random: Random) -> None:
    """A component of constraints stands there twice."""
    component = _one(random, list(m.component_objects(pyo.Constraint, active=True)))
    m.again = pyo.ConstraintList()
    by = random.choice([1.0, 2.0, -1.0])
    for row in component.values():
        _add(m.again, row, by)


# ---------------------------------------------------------------------------------------- another problem


@in_place(Law.STATED)
def row_dropped(m: Any, random: Random) -> None:
    """A row is missing."""
    _one(random, list(m.component_data_objects(pyo.Constraint, active=True))).deactivate()


@in_place(Law.STATED)
def component_dropped(m: Any, random: Random) -> None:
    """All rows of one kind are missing, or all pairs."""
    _one(random, list(m.component_objects((pyo.Constraint, rcp.Complementarity), active=True))).deactivate()


def other_name_read(problem: Problem, random: Random) -> Spoilt:
    """A rule reads ``b.y[t]`` where ``b.x[t]`` was meant."""
    picked = random.random(2)

    def spoilt(b: Any) -> Any:
        names = _signals(b)
        wrong, right = names[int(picked[0] * len(names))], names[int(picked[1] * len(names))]
        return _Misreading(b, right, lambda b: getattr(b, wrong)) if wrong != right else None

    return _misread(problem, random, spoilt, Law.STATED)


def index_shifted(problem: Problem, random: Random) -> Spoilt:
    """A rule reads the value of the time point before."""
    picked = random.random()

    def spoilt(b: Any) -> Any:
        names = _signals(b)
        name = names[int(picked * len(names))]
        return _Misreading(b, name, lambda b: _Before(getattr(b, name)))

    return _misread(problem, random, spoilt, Law.STATED)


def other_phase_read(problem: Problem, random: Random) -> Spoilt:
    """A rule of the second phase reads the first, where both have such times."""
    picked = random.random()

    def spoilt(b: Any) -> Any:
        other = rcp.phases_of(b.model())[0]
        names = [name for name in _signals(b) if name in _signals(other)]
        if other.name == b.name or list(other.time) != list(b.time) or not names:
            return None
        name = names[int(picked * len(names))]
        return _Misreading(b, name, lambda _: getattr(other, name))

    return _misread(problem, random, spoilt, Law.STATED)


def negated_cost(problem: Problem, random: Random) -> Spoilt:
    """The sign of the cost is wrong."""
    m = problem.build()
    objective = objective_of(m)
    objective.set_value(-objective.expr)
    return Spoilt(m, Law.STATED, -1.0)


@in_place(Law.STATED)
def bound_forgotten(m: Any, random: Random) -> None:
    """The bounds of one variable are missing."""
    bounded = {id(v.parent_component()): v.parent_component() for v in _free(m) if v.has_lb() or v.has_ub()}
    for v in _one(random, list(bounded.values())).values():
        v.setlb(None)
        v.setub(None)


def unbounded(problem: Problem, random: Random) -> Spoilt:
    """The sign of the cost is wrong and no variable has bounds."""
    spoilt = negated_cost(problem, random)
    for v in _free(spoilt.model):
        v.setlb(None)
        v.setub(None)
    return spoilt


@in_place(Law.STATED)
def start_forgotten(m: Any, random: Random) -> None:
    """A value that was given is missing."""
    _one(random, [v for v in m.component_data_objects(pyo.Var) if v.fixed]).unfix()


@in_place(Law.STATED)
def cost_forgotten_for_a_part(m: Any, random: Random) -> None:
    """The cost asks for one value only."""
    objective_of(m).set_value(_one(random, _free(m)) ** 2)


# ---------------------------------------------------------------------------------------- no problem at all


@in_place(Law.DOUBTED)
def contradiction(m: Any, random: Random) -> None:
    """An equation stands there twice, with two right-hand sides."""
    row = _one(random, [row for row in m.component_data_objects(pyo.Constraint, active=True) if row.equality])
    m.again = pyo.Constraint(expr=row.body == row.upper + random.choice([-1.0, 1.0]) * 10 ** random.uniform(-1, 1))


@in_place(Law.DOUBTED)
def start_beyond_a_bound(m: Any, random: Random) -> None:
    """A start is fixed where the bounds of the state forbid it."""
    v = _one(random, [v for v in _starts(m) if v.lb is not None or v.ub is not None])
    by = 10 ** random.uniform(-2, 1)
    v.fix(v.lb - by if v.lb is not None else v.ub + by, skip_validation=True)


@in_place(Law.DOUBTED, only="jacobson_lele")
def start_beyond_a_path_constraint(m: Any, random: Random) -> None:
    """A start is fixed where a path constraint forbids it; of the mesh only the points are asked."""
    m.p.y[0].fix(1.5 + 10 ** random.uniform(-1, 1))


def start_inside_the_floor(problem: Problem, random: Random) -> Spoilt:
    """A start is fixed where the gap of a contact is negative."""
    by = 10 ** random.uniform(-2, 0)
    starts = {"lift": lambda m: (m.p.height[0], -by), "dae_hanger": lambda m: (m.x[0], 1 + by)}
    if problem.name not in starts:
        raise NothingToSpoil
    m = problem.build()
    start, value = starts[problem.name](m)
    start.fix(value, skip_validation=True)
    return Spoilt(m, Law.DOUBTED)


@in_place(Law.DOUBTED, only="two_legs")
def phases_not_joined(m: Any, random: Random) -> None:
    """The link is missing, and nothing else joins the phases."""
    m.del_component(m.link)


@in_place(Law.DOUBTED, only="two_legs")
def part_deactivated(m: Any, random: Random) -> None:
    """One of two phases that are linked is not active."""
    (m.first if random.random() < 0.5 else m.second).deactivate()


@in_place(Law.DOUBTED, only="two_legs")
def state_left_over(m: Any, random: Random) -> None:
    """A link says what continues, and forgets a state."""
    m.del_component(m.link)
    m.link = rcp.Link(m.first, m.second, states=[str(random.choice(["x", "v"]))])


@in_place(Law.DOUBTED)
def rule_without_rows(m: Any, random: Random) -> None:
    """A rule asks for a time that is no point, and gives no row at all."""
    time, phases = random.uniform(0.0, 2.0), rcp.phases_of(m)
    if not phases:
        raise NothingToSpoil
    b = phases[0]
    x = b.component(_one(random, list(b.record.names_of_states)))
    low = random.uniform(-1.0, 1.0)
    b.constraint(lambda b, t: x[t] >= low if t == time else pyo.Constraint.Skip, name="at_that_time")


def not_discretised(problem: Problem, random: Random) -> Spoilt:
    """The transformation of a model of pyomo.dae was forgotten."""
    if problem.undiscretised is None:
        raise NothingToSpoil
    return Spoilt(problem.undiscretised(), Law.DOUBTED)


def pairs_not_relaxed(problem: Problem, random: Random) -> Spoilt:
    """A model with pairs is given to the solver of models without."""
    m = problem.build()
    if not rcp.active_pairs(m):
        raise NothingToSpoil
    derivatives = str(random.choice(["asl", "vectorised"]))

    def solve(model: Any) -> Any:
        return pyo.SolverFactory("pyrobocop.ipopt", derivatives=derivatives).solve(model)

    return Spoilt(m, Law.DOUBTED, solve=solve)


def other_model_read(problem: Problem, random: Random) -> Spoilt:
    """A rule reads a variable of another model of the same kind."""
    picked, other = random.random(), problem.build()
    phases = {phase.name: phase for phase in rcp.phases_of(other)}

    def spoilt(b: Any) -> Any:
        names, there = _signals(b), phases.get(b.name)
        name = names[int(picked * len(names))]
        return there and _Misreading(b, name, lambda _: getattr(there, name))

    found = _misread(problem, random, spoilt, Law.DOUBTED)
    found.model._kept_alive = other
    return found


@in_place(Law.DOUBTED)
def no_number(m: Any, random: Random) -> None:
    """Data hold a NaN: a given value, a bound or a coefficient."""
    rows = m.component_data_objects(pyo.Constraint, active=True)
    read = {id(v): v for row in rows for v in identify_variables(row.body)}  # what a transformation replaced is not
    fixed = [v for v in read.values() if v.fixed]
    where = random.integers(3)
    if where == 0 and fixed:
        _one(random, fixed).fix(nan)
    elif where == 1:
        row = _one(random, list(m.component_data_objects(pyo.Constraint, active=True)))
        row.set_value(_bounded(row.lower, row.body + nan * _one(random, _free(m)), row.upper))
    else:
        objective_of(m).set_value(objective_of(m).expr + nan * _one(random, _free(m)))


SPOILERS: dict[str, Spoiler] = {
    spoiler.__name__: spoiler
    for spoiler in (
        guess_far_away, other_units, scaled_objective, scaled_sides, scaled_row, scaled_by_pyomo, row_said_twice,
        row_dropped, component_dropped, other_name_read, index_shifted, other_phase_read, negated_cost, bound_forgotten,
        unbounded, start_forgotten, cost_forgotten_for_a_part, contradiction, start_beyond_a_bound,
        start_beyond_a_path_constraint, start_inside_the_floor, phases_not_joined, not_discretised, pairs_not_relaxed,
        other_model_read, no_number, part_deactivated, state_left_over, rule_without_rows,
    )
}  # fmt: skip


# ---------------------------------------------------------------------------------------- parts of models


def _free(m: Any) -> list[Any]:
    return [v for v in m.component_data_objects(pyo.Var) if not v.fixed]


def _starts(m: Any) -> list[Any]:
    """Values that are given where a phase starts, or anywhere in a model without phases."""
    phases = rcp.phases_of(m)
    if not phases:
        return [v for v in m.component_data_objects(pyo.Var) if v.fixed]
    first = [b.component(name)[b.initial_time] for b in phases for name in b.record.names_of_states]
    return [v for v in first if v.fixed]


def _one(random: Random, among: list[Any]) -> Any:
    """One of them at random."""
    if not among:
        raise NothingToSpoil
    return among[random.integers(len(among))]


def _signals(b: Any) -> list[str]:
    """Names that a rule reads at its time: of scalars, since vectors are read whole."""
    members = {member for family in b.record.families.values() for member in family.members}
    return [name for name in (*b.record.names_of_states, *b.record.names_of_signals) if name not in members]


# ---------------------------------------------------------------------------------------- expressions


def _bounded(lower: Any, body: Any, upper: Any) -> Any:
    if lower is not None and upper is not None and pyo.value(lower) == pyo.value(upper):
        return body == upper
    return (lower, body, upper)


def _times_number(by: float, number: Any) -> Any:
    return None if number is None else by * pyo.value(number)


def _times(by: float, relation: Any) -> Any:
    """Both sides of a relation, multiplied."""
    smaller, larger = relation.args
    return by * smaller <= by * larger


def _add(rows: Any, row: Any, by: float) -> None:
    lower, upper = _times_number(by, row.lower), _times_number(by, row.upper)
    rows.add(_bounded(*((lower, by * row.body, upper) if by > 0 else (upper, by * row.body, lower))))


# ---------------------------------------------------------------------------------------- rules


class _Misreading:
    """A phase as a rule sees it, with another thing under one name."""

    def __init__(self, block: Any, name: str, read: Callable[[Any], Any]) -> None:
        self._block, self._name, self._read = block, name, read

    def __getattr__(self, name: str) -> Any:
        return self._read(self._block) if name == self._name else getattr(self._block, name)


class _Before:
    """Values at the time before."""

    def __init__(self, signal: Any) -> None:
        self._signal = signal

    def __getitem__(self, t: Any) -> Any:
        times = sorted(self._signal.index_set())
        return self._signal[times[max(times.index(t) - 1, 0)]]


def _misread(problem: Problem, random: Random, spoilt: Callable[[Any], Any], law: Law) -> Spoilt:
    """The problem with rules of one kind that see another phase, where one reads what is wrong there."""
    tries = (_misread_by(str(kind), problem, spoilt) for kind in random.permutation(KINDS))
    for m in tries:
        if m is not None:
            return Spoilt(m, law)
    raise NothingToSpoil


def _misread_by(kind: str, problem: Problem, spoilt: Callable[[Any], Any]) -> pyo.ConcreteModel | None:
    done = []

    def changed(kind: str, rule: Any) -> Any:
        def misread(b: Any, t: Any) -> Any:
            seen = spoilt(b) if isinstance(b, PhaseBlockData) else None
            right = rule(b, t)
            if seen is None:
                return right
            wrong = rule(seen, t)
            done.append(str(wrong) != str(right))
            # What a rule calls its states is no slip.
            return dict(zip(right, wrong.values(), strict=True)) if isinstance(right, dict) else wrong

        return misread

    with _rules(changed, kind):
        try:
            m = problem.build()
        except (KeyError, TypeError, ValueError, AttributeError):
            return None  # Python's or Pyomo's own answer
    return m if any(done) else None


@contextmanager
def _rules(changed: Callable[[str, Any], Any], *kinds: str) -> Iterator[list[str]]:
    """Phases that are built meanwhile get changed rules; gives the names of those that were."""
    asked: list[str] = []

    def stating(kind: str) -> Any:
        state = getattr(PhaseBlockData, kind)

        @wraps(state)
        def stated(b: Any, rule: Any, *arguments: Any) -> Any:
            asked.append(kind)
            return state(b, wraps(rule)(changed(kind, rule)), *arguments)

        return stated

    with ExitStack() as patched:
        for kind in kinds:
            patched.enter_context(mock.patch.object(PhaseBlockData, kind, stating(kind)))
        yield asked
