"""What holds and what has a value at points that are no collocation points.

Equations hold at collocation points. Elsewhere (the first point for Radau, every element boundary for Gauss) only
states have a value of their own. Of other variables there,

* what the user has fixed at this point keeps its value, and is a condition there;
* the rest are candidates: the rows that stand there may determine them. `ShownValue` has a value for those that no
  row determines, which are absent.

Of the rows there hold:

* relations of states alone: path constraints at every point, equations at the first (consistency) but not at inner
  boundaries, where there would be more of them than unknowns; conditions that are stated there only stay;
* equations that determine an algebraic or a derivative from the states, and inequalities of those;
* at the first point other equations as well (`ShownValue`), since initial conditions may be stated for any variable;
* no pairs, but at the first point those of variables that these equations leave to choose.

The others are deactivated. Which equations determine something is read from two maximum matchings of rows and unknowns.

1. With the states at the first point among the unknowns, conditions on the initial state first: a row that would be one
   too many does not hold, such as a relation of states that are all fixed there.
2. With the states known: a row holds when it belongs to a part with as many rows as unknowns. Of the others
   `ShownValue` decides: they hold with the values that controls show, or at the first point as in the user's model,
   which may fix there what it likes.

What is indexed by a set that nothing has discretised yet is left as it is.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import chain
from typing import Any

from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.base.var import Var
from pyomo.dae import DerivativeVar

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.rows_by_rule import is_equality
from pyrobocop_pyomo.numerics import Matching

from .structure import PAIRS, Discretisation, Spot, axes_of, axis_on, open_sets, row_variables, variables_of_row

# What becomes of a row at a point without a stage.
HOLDS, UNDECIDED, SURPLUS = "holds", "leaves a variable to choose", "is one too many"

Absent = dict[int, tuple[Any, float]]


class HoldingRows:
    """The rows of a model with a set that was just discretised, and which of them hold.

    Parameters
    ----------
    spots : list of Spot
        All components of the model.
    discretisation : Discretisation

    Attributes
    ----------
    candidates : dict of id to (variable, point)
        Variables that the rows at their points may determine, each with a point at which it has no value.
    absent : dict of id to (variable, point)
        Those of them that no row determines.
    used : set of int
        Ids of the variables in rows that hold.
    undetermined : list of (ConstraintData, variables)
        Equations that were deactivated because they leave variables undetermined.
    asked_for : set of int
        Ids of variables at the first point that other rows hold, such as ``dx[0] == 0``.
    first_pairs : list of (pair, ids of its variables)
        At the first point: a pair holds there where all its variables do, and the value of a neighbour would violate
        it.
    """

    def __init__(self, spots: list[Spot], discretisation: Discretisation) -> None:
        self._spots, self._discretisation, self._domain = spots, discretisation, discretisation.domain
        self._points, self._states = frozenset(discretisation.grid.points), discretisation.state_ids()
        self._open_ids = open_sets(spots)
        self.candidates: Absent = {}
        self.absent: Absent = {}
        self._fixed_rates: dict[int, Any] = {}  # derivatives that the user has fixed at points of this kind, by id
        self._conditions: set[int] = set()  # ids of other variables that are fixed there, and not everywhere
        self._families: set[Any] = set()  # of equations that hold at collocation points
        self._inside: list[Any] = []  # rows and pairs that hold in any case
        self._held: list[Any] = []  # equations that hold in any case where the set starts, or anywhere
        self.used: set[int] = set()
        self.undetermined: list[tuple[Any, list[Any]]] = []
        self.asked_for: set[int] = set()
        self.first_pairs: list[tuple[Any, Collection[int]]] = []
        self._find_candidates()

    # ---------------------------------------------------------------- where things stand

    def _is_along(self, spot: Spot) -> bool:
        """Whether a component is indexed by the set, and by no other that is still to be discretised."""
        sets = {id(domain) for domain, _ in spot.outer} | {id(axis.domain) for axis in axes_of(spot.component)}
        return id(self._domain) in sets and sets.isdisjoint(self._open_ids)

    def _standing(self, spot: Spot) -> Iterator[tuple[Any, Any, float | None]]:
        """Family and data of each member, and its point of the set where that is no collocation point."""
        if self._is_along(spot):
            for family, time, data in spot.members_along(self._domain):
                yield family, data, None if time in self._points else time
        else:
            yield from ((None, data, None) for data in spot.component.values())

    def is_first(self, time: float) -> bool:
        """True for the first point of the set."""
        return time == self._discretisation.grid.times[0]

    def _find_candidates(self) -> None:
        for spot in self._spots:
            component = spot.component
            if component.ctype not in (Var, DerivativeVar) or component.is_reference():
                continue
            for _, data, time in self._standing(spot):
                if time is None or id(data) in self._states:
                    continue
                if not data.fixed or data.value is None:
                    self.candidates[id(data)] = (data, time)
                elif isinstance(component, DerivativeVar):
                    self._fixed_rates[id(data)] = data
                elif not component.is_indexed() or not all(other.fixed for other in component.values()):
                    self._conditions.add(id(data))

    # ---------------------------------------------------------------- rows

    def deactivate_rows(self) -> None:
        """Deactivate the rows and pairs that do not hold, and note them in the discretisation.

        Raises
        ------
        ModelError
            When what holds, or an objective, needs a variable that is not there, or an equation is missing.
        """
        outside: list[tuple[Any, Any, float, dict[int, Any]]] = []
        for spot in self._spots:
            component = spot.component
            if component.ctype not in (Constraint, Objective, *PAIRS) or not spot.active or component.is_reference():
                continue
            inside = []
            for family, data, time in self._standing(spot):
                if not data.active:
                    continue
                if time is not None and component.ctype is not Objective:
                    variables = {id(variable): variable for variable in variables_of_row(data)}
                    outside.append((data, family, time, variables))
                    continue
                inside.append(data)
                if component.ctype is Constraint and is_equality(data):
                    if family is None:
                        self._held.append(data)
                    self._families.add(family)
            self._inside += inside
            self.used |= row_variables(inside, ())[1]
        self._refuse_missing_equations(self.used.union(*(variables for _, _, _, variables in outside)))
        pending: list[tuple[Any, list[Any]]] = []
        inequalities: list[tuple[Any, set[int]]] = []
        for data, family, time, variables in outside:
            if self._follows(data, family, time, variables):
                if data.ctype in PAIRS and self.is_first(time):
                    self.first_pairs.append((data, variables.keys()))
                self._deactivate(data)
            elif not self._is_unsettled(data, time, variables):
                self.used |= variables.keys()
                if data.equality:
                    self._held.append(data)
            elif data.equality:
                pending.append((data, self._unknowns(variables, time)))
            else:
                inequalities.append((data, set(variables)))
        self._settle(pending, inequalities)
        self._check_fixed()

    def _deactivate(self, data: Any) -> None:
        data.deactivate()
        self._discretisation.deactivated.append(data)

    def _follows(self, data: Any, family: Any, time: float, variables: dict[int, Any]) -> bool:
        """True for a pair or an equation of states: it holds at the collocation points, so it need not hold here."""
        if data.ctype in PAIRS:
            return True
        decided = self.candidates.keys() | self._conditions
        is_equation_inside = data.equality and not self.is_first(time)
        return is_equation_inside and decided.isdisjoint(variables) and family in self._families

    def _is_unsettled(self, data: Any, time: float, variables: dict[int, Any]) -> bool:
        """True for a row of which the others have to be known to decide on it.

        These are rows with candidates for a value, and equations at the first point that may be one too many: those
        with a variable that the user has fixed there.
        """
        may_be_surplus = data.equality and self.is_first(time) and not self._conditions.isdisjoint(variables)
        return may_be_surplus or not self.candidates.keys().isdisjoint(variables)

    def _unknowns(self, variables: dict[int, Any], time: float) -> list[Any]:
        """The variables of a row that it may determine: no state but at the first point of the set."""
        known = () if self.is_first(time) else variables.keys() - self.candidates.keys()
        return [variable for key, variable in variables.items() if key not in known and not variable.fixed]

    def _refuse_missing_equations(self, stated: set[int]) -> None:
        """Raise a `ModelError` where a derivative has an equation at some collocation points of a line only."""
        states = set(map(id, self._discretisation.states))
        for _, rate in self._discretisation.derivatives:
            axes = axes_of(rate)
            if id(rate) in states or any(id(axis.domain) in self._open_ids for axis in axes):
                continue
            axis = next(axis for axis in axes if axis.domain is self._domain)
            lines: dict[Any, list[tuple[bool, Any]]] = {}
            for index, data in rate.items():
                if axis.time(index) in self._points:
                    has_equation = id(data) in stated or (data.fixed and data.value is not None)
                    lines.setdefault(axis.others(index), []).append((has_equation, data))
            for line in lines.values():
                missing = [data for has_equation, data in line if not has_equation]
                if 0 < len(missing) < len(line):
                    raise ModelError(
                        f"'{missing[0].name}': has no equation, though the same derivative has one at other points. "
                        f"Index the constraint by '{self._domain.local_name}' itself, not by a list of its points; "
                        "Constraint.Skip may leave out points without a collocation point: gauss has none at either "
                        "end of a set."
                    )

    def _settle(self, pending: list[tuple[Any, list[Any]]], inequalities: list[tuple[Any, set[int]]]) -> None:
        """Decide on the rows at points without a stage, and which variables there have a value."""
        candidates, determined, needed = self.candidates, set[int](), set(self.used)
        held = [{id(v): v for v in variables_of_row(data) if not v.fixed} for data in self._held if pending]
        for (data, variables), decision in zip(pending, rows_that_hold(pending, held, candidates), strict=True):
            if decision == HOLDS:
                determined.update(map(id, variables))
                if self._is_initial(variables):
                    self.used.update(map(id, variables_of_row(data)))
                continue
            self._deactivate(data)
            if decision == UNDECIDED:
                self.undetermined.append((data, variables))
        for data, ids in inequalities:
            if candidates.keys() & ids <= determined:
                determined |= ids
            else:
                self._deactivate(data)
        for key in candidates.keys() - determined:
            self.absent[key] = candidates[key]
            if key in needed and not self._is_initial_condition(*candidates[key]):
                raise self._refusal(*candidates[key])
        self.used |= determined

    def _user_of(self, variable: Any) -> Any:
        """A row that holds in any case and has a variable."""
        return next(row for row in self._inside if any(held is variable for held in variables_of_row(row)))

    def _is_initial_condition(self, variable: Any, time: float) -> bool:
        """True, and noted, for a variable in an equation of its own at the first point, which others there can meet.

        An equation of controls alone is none: nothing else would know of it.
        """
        row = self._user_of(variable)
        if row.ctype is not Constraint or not row.equality or not self.is_first(time):
            return False
        # As many unknowns as the other rows there can give, derivatives before others.
        rates = [key for key, (data, _) in self.candidates.items() if self._is_rate(data)]
        holding: dict[int, list[int]] = {key: [] for key in (*rates, *self.candidates)}
        for i, (_, variables) in enumerate(self.undetermined):
            for key in holding.keys() & map(id, variables):
                holding[key].append(i)
        given = {list(holding)[i] for i in Matching(holding.values(), range(len(self.undetermined))).row_of.values()}
        if (given | self._states).isdisjoint(map(id, variables_of_row(row))):
            return False
        self.asked_for.add(id(variable))
        return True

    def _is_initial(self, variables: list[Any]) -> bool:
        """Whether all of these variables that are candidates belong to the first point of the set."""
        places = (self.candidates.get(id(variable)) for variable in variables)
        return all(place is None or self.is_first(place[1]) for place in places)

    def _is_rate(self, data: Any) -> bool:
        component = data.parent_component()
        return any(component is rate for _, rate in self._discretisation.derivatives)

    def given_by_shown_values(
        self, part: list[Any], ids: set[int], sources: Collection[int], definitions: dict[int, Any]
    ) -> set[int]:
        """The derivatives that the rows of a part give once controls show their values; none where it is not so.

        An equation of motion with a mass matrix is such a row. Algebraics have to be given explicitly: an implicit
        equation need not have a solution for the values that are shown.
        """
        explicit = {id(row) for row in definitions.values()}
        candidates = {key: self.absent[key][0] for key in ids - definitions.keys()}
        rates = {
            key for key, v in candidates.items() if self._is_rate(v) and not v.fixed and v.lower is v.upper is None
        }
        rest = [[id(v) for v in variables_of_row(row) if id(v) in rates] for row in part if id(row) not in explicit]
        is_square = len(rest) == len(rates) == len(Matching(rest, rates).row_of)
        is_free = self.asked_for.isdisjoint(ids) and ids - rates <= sources | definitions.keys()
        return rates if is_square and is_free else set()

    def what_follows(self, rows: Iterable[Any], ids: Collection[int]) -> tuple[Any, ...]:
        """The variables of rows that have these ids, or that the user has fixed at their points."""
        ids = {*ids, *self._fixed_rates, *self._conditions}
        return tuple({id(v): v for row in rows for v in variables_of_row(row) if id(v) in ids}.values())

    def _check_fixed(self) -> None:
        used = set(self.used)
        for row, variables in self.undetermined:
            if self._is_initial(variables):
                used |= {id(variable) for variable in variables_of_row(row)}
        for key, data in self._fixed_rates.items():
            component, axis = data.parent_component(), axis_on(data.parent_component(), self._domain)
            line = [component[axis.join(axis.others(data.index()), t)] for t in self._domain] if axis else []
            # Where nothing else along the set holds the derivative either, the number is not part of any statement.
            if key not in used and any(id(point) in used and not point.fixed for point in line):
                raise ModelError(
                    f"'{data.name}': is fixed, but no equation that holds at that point has it. State the condition in "
                    "states alone, index the equation by the whole set, or choose lobatto."
                )

    def _refusal(self, variable: Any, time: float) -> ModelError:
        """What to raise where a row that holds in any case needs a variable without a value."""
        name, scheme = self._domain.local_name, self._discretisation.grid.scheme.name
        return ModelError(
            f"'{self._user_of(variable).name}': holds '{variable.name}', but {scheme} has no collocation point at "
            f"{name} = {time:g}: only states have a value there. Leave that point out, write an Integral for a sum "
            f"over '{name}', or choose a scheme with a point there: radau has one at the end, lobatto at both ends."
        )


def rows_that_hold(
    pending: Sequence[tuple[Any, list[Any]]],
    conditions: Iterable[Iterable[int]],
    candidates: Collection[int],
) -> list[str]:
    """Decide on rows at points without a stage.

    Parameters
    ----------
    pending : sequence of (row, variables)
        The rows, each with the variables that it may determine. The first of those that cannot all hold are kept.
    conditions : iterable of iterable of int
        The ids of the variables, not fixed, of rows that hold in any case.
    candidates : collection of int
        Ids of the variables in question; all others are states, or known for another reason.

    Returns
    -------
    list of str
        `HOLDS`, `UNDECIDED` or `SURPLUS` for each pending row.
    """
    own = [[id(variable) for variable in variables] for _, variables in pending]
    first = list(map(list, conditions))
    surplus = {row - len(first) for row in Matching([*first, *own], chain(*first, *own)).unmatched_rows}
    left = [() if i in surplus else row for i, row in enumerate(own)]
    short = set(Matching(left, (key for row in left for key in row if key in candidates)).underdetermined[0])
    return [SURPLUS if i in surplus else UNDECIDED if i in short else HOLDS for i in range(len(own))]


def undecided_parts(rows: Sequence[tuple[Any, list[Any]]], absent: Collection[int]) -> list[tuple[list[Any], set[int]]]:
    """The parts of rows that leave variables to choose, each with the ids of its variables.

    Parameters
    ----------
    rows : sequence of (row, variables)
    absent : collection of int
        Ids of the variables without a value of their own.
    """
    known = set(absent)
    part_of: dict[int, tuple[list[int], set[int]]] = {}  # by the id of a variable
    for i, (_, variables) in enumerate(rows):
        own = {id(variable) for variable in variables} & known
        joined = {id(part_of[key]): part_of[key] for key in own if key in part_of}.values()
        part = [*chain.from_iterable(places for places, _ in joined), i], own.union(*(ids for _, ids in joined))
        part_of.update(dict.fromkeys(part[1], part))
    parts = {min(part[0]): part for part in part_of.values()}
    return [([rows[i][0] for i in sorted(parts[first][0])], parts[first][1]) for first in sorted(parts)]
