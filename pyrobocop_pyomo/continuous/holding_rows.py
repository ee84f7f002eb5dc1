"""What holds and what has a value at points that are no collocation points.

Equations hold at collocation points. Elsewhere (the first point for Radau, every element boundary for Gauss) only
states have a value of their own. Of other variables there,

* what the user has fixed at this point keeps its value, and is a condition there;
* the rest are candidates: the rows that stand there may determine them. `shown_values` has a value for those that no
  row determines, which are absent.

Of the rows there hold:

* relations of states alone: path constraints at every point, equations at the first (consistency) but not at inner
  boundaries, where there would be more of them than unknowns; conditions that are stated there only stay;
* equations that determine an algebraic or a derivative from the states, and inequalities of those;
* at the first point other equations as well (`shown_values`), since initial conditions may be stated for any variable;
* no pairs, but at the first point those of variables that these equations leave to choose.

The others are deactivated. With several sets there is more to say: generated rows may be one too many. What is indexed
by a set that nothing has discretised yet is left as it is, since whoever discretises that set will look at it again.

Where the scheme has no stage, states have a value of their own and nothing else. The rows that stand there can
determine more: an algebraic from its equation, ``du/dx`` at ``t = 0`` from the rows along space. Which of them hold is
read from two maximum matchings of rows and unknowns at that point.

1. With the states at a first point among the unknowns, conditions on the initial state first: a row that would be one
   too many does not hold, such as a boundary condition at a corner where the initial state is given.
2. With the states known: a row holds when it belongs to a part with as many rows as unknowns. Rows that leave
   derivatives along another set undetermined do not hold. Of the others
   `shown_values` decides: they hold with the values that controls show, or at the first point as in the user's model,
   which may fix there what it likes.
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
from pyrobocop_pyomo.modeling.shared_nodes import variables_in_any
from pyrobocop_pyomo.numerics import Matching

from .record import Discretisation, open_sets
from .structure import PAIRS, Spot, axes_of, continuous_sets, variables_of_row

# What becomes of a row at a point without a stage.
HOLDS, UNDECIDED, SURPLUS = "holds", "leaves a variable to choose", "is one too many"

Pending = tuple[int, Any, list[Any]]  # id of a set, row at one of its points, what the row may determine


class HoldingRows:
    """The rows of a model with discretised sets, and which of them hold.

    Parameters
    ----------
    spots : list of Spot
        All components of the model.
    discretisations : iterable of Discretisation

    Attributes
    ----------
    candidates : dict of id to (variable, ContinuousSet, point)
        Variables that the rows at their points may determine, and the first point at which they have no value.
    absent : dict of id to (variable, ContinuousSet, point)
        Those of them that no row determines.
    used : set of int
        Ids of the variables in rows that hold.
    undetermined : list of (ConstraintData, variables)
        Equations of the user's that were deactivated because they leave variables undetermined.
    asked_for : set of int
        Ids of variables at first points that other rows hold, such as ``dx[0] == 0``.
    first_pairs : list of (pair, ids of its variables)
        At first points: a pair holds there where all its variables do, and the value of a neighbour would violate it.
    """

    def __init__(self, spots: list[Spot], discretisations: Iterable[Discretisation]) -> None:
        self._spots = spots
        self._discretisations = {id(discretisation.domain): discretisation for discretisation in discretisations}
        everything = self._discretisations.values()
        self._points = {id(one.domain): frozenset(one.grid.points) for one in everything}
        sets = continuous_sets(spots)
        self._open_ids, self._several = open_sets(sets), len(sets) > 1
        self._generated = {id(rows) for one in everything for rows in one.generated_constraints()}
        self.candidates: dict[int, tuple[Any, Any, float]] = {}
        self.absent: dict[int, tuple[Any, Any, float]] = {}
        self._fixed_rates: dict[int, Any] = {}  # derivatives that the user has fixed at points of this kind, by id
        self._conditions: set[int] = set()  # ids of other variables that are fixed there, and not everywhere
        self._users: dict[int, Any] = {}  # a row that holds in any case, by the ids of candidates in it
        self._families: set[Any] = set()  # of equations that hold at collocation points
        self.used: set[int] = set()
        self.undetermined: list[tuple[Any, list[Any]]] = []
        self.asked_for: set[int] = set()
        self.first_pairs: list[tuple[Any, Collection[int]]] = []
        self._find_candidates()

    # ---------------------------------------------------------------- where things stand

    def _standing(self, spot: Spot) -> Iterator[tuple[Any, Any, tuple[Any, float] | None]]:
        """Index and data of each member, and the first set with the point of it that is no collocation point."""
        axes = axes_of(spot.component)
        sets = {id(domain) for domain, _ in spot.outer} | {id(axis.domain) for axis in axes}
        is_settled = sets.isdisjoint(self._points) or not sets.isdisjoint(self._open_ids)
        for index, data in spot.component.items():
            yield index, data, None if is_settled else next(self._outside(spot.points(index, axes)), None)

    def _outside(self, points: Iterable[tuple[Any, Any]]) -> Iterator[tuple[Any, float]]:
        for domain, time in points:
            if id(domain) in self._points and time not in self._points[id(domain)]:
                yield domain, time

    def is_first(self, domain: Any, time: float) -> bool:
        """True for the first point of a discretised set."""
        return time == self._discretisations[id(domain)].grid.times[0]

    def _find_candidates(self) -> None:
        states = {key: discretisation.state_ids() for key, discretisation in self._discretisations.items()}
        for spot in self._spots:
            component = spot.component
            if component.ctype not in (Var, DerivativeVar) or component.is_reference():
                continue
            axes = axes_of(component)
            for index, data, point in self._standing(spot):
                places = () if point is None else self._outside(spot.points(index, axes))
                place = next((place for place in places if id(data) not in states[id(place[0])]), None)
                if place is None:
                    continue
                if not data.fixed or data.value is None:
                    self.candidates[id(data)] = (data, *place)
                elif isinstance(component, DerivativeVar):
                    self._fixed_rates[id(data)] = data
                elif not component.is_indexed() or not all(other.fixed for other in component.values()):
                    self._conditions.add(id(data))

    # ---------------------------------------------------------------- rows

    def deactivate_rows(self, deactivated: list[Any]) -> None:
        """Deactivate the rows and pairs that do not hold, and append them to the list; delete the generated ones.

        Raises
        ------
        ModelError
            When what holds, or an objective, needs a variable that is not there, or an equation is missing.
        """
        pending: list[Pending] = []
        outside: list[tuple[Any, Any, tuple[Any, float], dict[int, Any]]] = []
        for spot in self._spots:
            component = spot.component
            if component.ctype not in (Constraint, Objective, *PAIRS) or not spot.active or component.is_reference():
                continue
            if id(component) in self._generated:
                if len(self._discretisations) > 1:
                    pending += self._pending_generated(component)
                continue
            axes, inside = axes_of(component), []
            for index, data, point in self._standing(spot):
                if not data.active:
                    continue
                if point is None:
                    inside.append(data)
                    if component.ctype is Constraint and data.equality and (axes or spot.outer):
                        self._families.add(spot.family(index, axes))
                else:
                    variables = {id(variable): variable for variable in variables_of_row(data)}
                    outside.append((data, spot.family(index, axes), point, variables))
            self.used |= self._variables_inside(component, inside)
        self._refuse_missing_equations(self.used.union(*(variables for _, _, _, variables in outside)))
        inequalities: list[tuple[Any, set[int]]] = []
        for data, family, point, variables in outside:
            if self._follows(data, family, point, variables):
                if data.ctype in PAIRS and self.is_first(*point):
                    self.first_pairs.append((data, variables.keys()))
                self._deactivate(data, deactivated)
            elif not self._is_unsettled(data, family, point, variables):
                self.used |= variables.keys()
            elif data.equality:
                pending.append((id(point[0]), data, self._unknowns(variables, point)))
            else:
                inequalities.append((data, set(variables)))
        self._settle(pending, inequalities, deactivated)
        self._check_fixed()

    @staticmethod
    def _deactivate(data: Any, deactivated: list[Any]) -> None:
        data.deactivate()
        deactivated.append(data)

    def _variables_inside(self, component: Any, rows: list[Any]) -> set[int]:
        """Ids of the variables of rows that hold in any case."""
        candidates = self.candidates
        if component.ctype not in PAIRS:
            everything = set(variables_in_any(data.expr for data in rows))
            if candidates.keys().isdisjoint(everything):
                return everything
        everything = set()
        for data in rows:
            for variable in variables_of_row(data):
                if id(variable) in candidates:
                    self._users.setdefault(id(variable), data)
                everything.add(id(variable))
        return everything

    def _follows(self, data: Any, family: Any, point: tuple[Any, float], variables: dict[int, Any]) -> bool:
        """True for a pair or an equation of states: it holds at the collocation points, so it need not hold here."""
        if data.ctype in PAIRS:
            return True
        decided = self.candidates.keys() | self._conditions
        is_equation_inside = data.ctype is Constraint and data.equality and not self.is_first(*point)
        return is_equation_inside and decided.isdisjoint(variables) and family in self._families

    def _is_unsettled(self, data: Any, family: Any, point: tuple[Any, float], variables: dict[int, Any]) -> bool:
        """True for a row of which the others have to be known to decide on it.

        These are rows with candidates for a value, and equations at the first point of a set that may be one too many:
        those with a variable that the user has fixed there, and, where there are several sets, those that hold at the
        collocation points as well, such as a boundary condition at the initial time.
        """
        if data.ctype is not Constraint:
            return False
        if not self.candidates.keys().isdisjoint(variables):
            return True
        is_first = data.equality and self.is_first(*point)
        may_be_surplus = self._several and family in self._families
        return is_first and (may_be_surplus or not self._conditions.isdisjoint(variables))

    def _unknowns(self, variables: dict[int, Any], point: tuple[Any, float]) -> list[Any]:
        """The variables of a row that it may determine: no state but at the first point of a set."""
        known = () if self.is_first(*point) else variables.keys() - self.candidates.keys()
        return [variable for key, variable in variables.items() if key not in known and not variable.fixed]

    # ---------------------------------------------------------------- generated rows

    def _pending_generated(self, rows: Any) -> list[Pending]:
        """The rows that hold candidates, with their variables; of two joints at one point one is deleted."""
        pending, candidates, axes = [], self.candidates, axes_of(rows)
        joined_before = self._joined_before(rows)
        for index, data in list(rows.items()):
            if any(axis.time(index) in joined_before.get(id(axis.domain), ()) for axis in axes):
                del rows[index]
                continue
            variables = {id(variable): variable for variable in variables_of_row(data)} if data.active else {}
            place = next((id(candidates[key][1]) for key in variables if key in candidates), None)
            if place is not None:
                pending.append((place, data, [variable for variable in variables.values() if not variable.fixed]))
        return pending

    def _joined_before(self, rows: Any) -> dict[int, tuple[float, ...]]:
        """For rows that join elements, where elements of earlier sets are joined for the same state, by their sets."""
        found: dict[int, tuple[set[int], tuple[float, ...]]] = {}
        for domain, discretisation in self._discretisations.items():
            state = next((state for state, joints in discretisation.joints if joints is rows), None)
            if state is not None:
                return {key: ends for key, (states, ends) in found.items() if id(state) in states}
            found[domain] = {id(state) for state, _ in discretisation.joints}, discretisation.grid.mesh.boundaries[1:]
        return {}

    # ---------------------------------------------------------------- missing equations, starts of sets

    def _refuse_missing_equations(self, stated: set[int]) -> None:
        """Raise a `ModelError` where a derivative has an equation at some collocation points of a line only."""
        for discretisation in self._discretisations.values():
            points, states = frozenset(discretisation.grid.points), set(map(id, discretisation.states))
            for _, rate in discretisation.derivatives:
                axes = axes_of(rate)
                if id(rate) in states or any(id(axis.domain) in self._open_ids for axis in axes):
                    continue
                axis = next(axis for axis in axes if axis.domain is discretisation.domain)
                lines: dict[Any, list[tuple[bool, Any]]] = {}
                for index, data in rate.items():
                    if axis.time(index) in points:
                        has_equation = id(data) in stated or (data.fixed and data.value is not None)
                        lines.setdefault(axis.others(index), []).append((has_equation, data))
                for line in lines.values():
                    missing = [data for has_equation, data in line if not has_equation]
                    if 0 < len(missing) < len(line):
                        raise ModelError(
                            f"'{missing[0].name}': has no equation, though the same derivative has one at other "
                            f"points. Index the constraint by '{axis.domain.local_name}' itself, not by a list of its "
                            "points; Constraint.Skip may leave out points without a collocation point: gauss has none "
                            "at either end of a set."
                        )

    def _settle(self, pending: list[Pending], inequalities: list[tuple[Any, set[int]]], deactivated: list[Any]) -> None:
        """Decide on the rows at the first points of sets, and which variables there have a value."""
        candidates, determined = self.candidates, set[int]()
        for key, discretisation in self._discretisations.items():
            own = [(data, variables) for where, data, variables in pending if where == key]
            if not own:
                continue
            answers = rows_that_hold(own, self._held_rows(own, discretisation), candidates.keys() - determined)
            for (data, variables), decision in zip(own, answers, strict=True):
                if decision == HOLDS:
                    determined.update(map(id, variables))
                    if self._is_initial(variables):
                        self.used.update(map(id, variables_of_row(data)))
                elif id(data.parent_component()) in self._generated:
                    del data.parent_component()[data.index()]
                else:
                    self._deactivate(data, deactivated)
                    if decision == UNDECIDED:
                        self.undetermined.append((data, variables))
        for data, ids in inequalities:
            if candidates.keys() & ids <= determined:
                determined |= ids
            else:
                self._deactivate(data, deactivated)
        for key in candidates.keys() - determined:
            self.absent[key] = candidates[key]
            if key in self._users and not self._is_initial_condition(key):
                raise self._refusal(self._users[key], *candidates[key])
        self.used |= determined

    def _is_initial_condition(self, key: int) -> bool:
        """True, and noted, for a variable in an equation of its own at the first point, which others there can meet.

        An equation of controls alone is none: nothing else would know of it.
        """
        row, (_, domain, time) = self._users[key], self.candidates[key]
        if row.ctype is not Constraint or not row.equality or not self.is_first(domain, time):
            return False
        rows = [[id(variable) for variable in variables] for _, variables in self.undetermined]
        derivatives = [k for k, (data, _, _) in self.candidates.items() if self._is_rate(data)]
        known = columns_that_rows_give(rows, [*derivatives, *self.candidates])
        known |= self._discretisations[id(domain)].state_ids()
        if known.isdisjoint(map(id, variables_of_row(row))):
            return False
        self.asked_for.add(key)
        return True

    def _is_initial(self, variables: list[Any]) -> bool:
        """Whether the candidates among variables stand at the first point of a set."""
        places = (self.candidates.get(id(variable)) for variable in variables)
        return all(place is None or self.is_first(*place[1:]) for place in places)

    def _is_rate(self, data: Any) -> bool:
        component = data.parent_component()
        return any(component is rate for one in self._discretisations.values() for _, rate in one.derivatives)

    def _held_rows(self, pending: list[tuple[Any, list[Any]]], discretisation: Discretisation) -> list[list[Any]]:
        """The variables of equations that hold at the first point of a set in any case."""
        rows, points = {id(data) for data, _ in pending}, frozenset(discretisation.grid.points)
        found = []
        for spot in self._spots:
            if spot.component.ctype is not Constraint or not spot.active or spot.component.is_reference():
                continue
            axes = [axis for axis in axes_of(spot.component) if axis.domain is discretisation.domain]
            if any(domain is discretisation.domain and time in points for domain, time in spot.outer):
                continue
            for index, data in spot.component.items():
                if any(axis.time(index) in points for axis in axes):
                    continue
                if data.active and data.equality and id(data) not in rows:
                    found.append(list({id(v): v for v in variables_of_row(data) if not v.fixed}.values()))
        return found

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
        is_square = len(rest) == len(rates) == len(columns_that_rows_give(rest, rates))
        return (
            rates
            if is_square and self.asked_for.isdisjoint(ids) and ids - rates <= sources | definitions.keys()
            else set()
        )

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
            component = data.parent_component()
            axes = tuple(axis for axis in axes_of(component) if id(axis.domain) in self._discretisations)
            line = [component[axis.join(axis.others(data.index()), t)] for axis in axes for t in axis.domain]
            # Where nothing else along the set holds the derivative either, the number is not part of any statement.
            if key not in used and any(id(point) in used and not point.fixed for point in line):
                raise ModelError(
                    f"'{data.name}': is fixed, but no equation that holds at that point has it. State the condition in "
                    "states alone, index the equation by the whole set, or choose lobatto."
                )

    def _refusal(self, data: Any, variable: Any, domain: Any, time: float) -> ModelError:
        """What to raise where a row that holds in any case needs a variable without a value."""
        scheme = self._discretisations[id(domain)].grid.scheme
        return ModelError(
            f"'{data.name}': holds '{variable.name}', but {scheme.name} has no collocation point at "
            f"{domain.local_name} = {time:g}: only states have a value there. Leave that point out, write an Integral "
            f"for a sum over '{domain.local_name}', or choose a scheme with a point there: radau has one at the end, "
            "lobatto at both ends."
        )


def rows_that_hold(
    pending: Sequence[tuple[Any, list[Any]]],
    conditions: Iterable[list[Any]],
    candidates: Collection[int],
) -> list[str]:
    """Decide on rows at points without a stage.

    Parameters
    ----------
    pending : sequence of (row, variables)
        The rows, each with the variables that it may determine. The first of those that cannot all hold are kept.
    conditions : iterable of list of variables
        The variables, not fixed, of rows that hold in any case.
    candidates : collection of int
        Ids of the variables in question; all others are states, or known for another reason.

    Returns
    -------
    list of str
        `HOLDS`, `UNDECIDED` or `SURPLUS` for each pending row.
    """
    own = [[id(variable) for variable in variables] for _, variables in pending]
    first = [[id(variable) for variable in variables] for variables in conditions]
    surplus = {row - len(first) for row in Matching([*first, *own], chain(*first, *own)).unmatched_rows}
    left = [() if i in surplus else row for i, row in enumerate(own)]
    short = set(Matching(left, (key for row in left for key in row if key in candidates)).underdetermined[0])
    return [SURPLUS if i in surplus else UNDECIDED if i in short else HOLDS for i in range(len(own))]


def columns_that_rows_give(rows: Sequence[Sequence[int]], order: Iterable[int]) -> set[int]:
    """As many unknowns as the rows can give, those that come first in an order before others."""
    rows_with: dict[int, list[int]] = {key: [] for key in order}
    for i, row in enumerate(rows):
        for key in rows_with.keys() & row:
            rows_with[key].append(i)
    keys = list(rows_with)
    return {keys[i] for i in Matching(rows_with.values(), range(len(rows))).row_of.values()}


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
