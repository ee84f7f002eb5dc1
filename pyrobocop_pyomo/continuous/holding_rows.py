"""Which rows hold at points that are no collocation points.

Equations hold at collocation points. Elsewhere only states have a value of their own (`absent_values`), and of the rows
there hold:

* relations of states alone: path constraints at every point, equations at the first (consistency) but not at inner
  boundaries, where there would be more of them than unknowns; conditions that are stated there only stay;
* equations that determine an algebraic or a derivative from the states (`point_values`), and inequalities of those;
  with several sets at their first points only;
* at the first point other equations as well (`shown_values`), since initial conditions may be stated for any variable;
* no pairs, but at the first point those of variables that these equations leave to choose.

The others are deactivated. With several sets there is more to say: generated rows may be one too many.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.shared_nodes import variables_in_any

from .absent_values import AbsentValues
from .point_values import HOLDS, UNDECIDED, columns_that_rows_give, rows_that_hold
from .record import Discretisation
from .structure import PAIRS, Spot, axes_of, variables_of_row

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
    values : AbsentValues
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
        self.values = AbsentValues(spots, self._discretisations.values())
        self._generated = {
            id(rows)
            for discretisation in self._discretisations.values()
            for rows in discretisation.generated_constraints()
        }
        self._dropped: set[int] = set()  # ids of variables in rows that do not hold
        self._users: dict[int, Any] = {}  # a row that holds in any case, by the ids of candidates in it
        self._along: set[Any] | None = None
        self.used: set[int] = set()
        self.undetermined: list[tuple[Any, list[Any]]] = []
        self.asked_for: set[int] = set()
        self.first_pairs: list[tuple[Any, Collection[int]]] = []
        self._refused: ModelError | None = None

    def deactivate_rows(self, deactivated: list[Any]) -> None:
        """Deactivate the rows and pairs that do not hold, and append them to the list; delete the generated ones.

        Raises
        ------
        ModelError
            When what holds, or an objective, needs a variable that is not there, or an equation is missing.
        """
        pending: list[Pending] = []
        inequalities: list[tuple[Any, set[int]]] = []
        for spot in self._spots:
            component = spot.component
            if component.ctype not in (Constraint, Objective, *PAIRS) or not spot.active or component.is_reference():
                continue
            axes, generated = axes_of(component), id(component) in self._generated
            if generated:
                if len(self._discretisations) > 1:
                    pending += self._pending_generated(component)
                continue
            outside = {} if self.values.waits(spot, axes) else dict(self.values.members_outside(spot, axes))
            inside = [data for index, data in component.items() if index not in outside and data.active]
            self.used |= self._variables_inside(component, inside)
            for index, data in outside.items():
                if not data.active:
                    continue
                variables = {id(variable): variable for variable in variables_of_row(data)}
                family, point = spot.family(index, axes), self.values.outside(spot.points(index, axes))
                assert point is not None
                if self._follows(data, family, point, variables):
                    self._dropped |= variables.keys()
                    if data.ctype in PAIRS and self.values.is_first(*point):
                        self.first_pairs.append((data, variables.keys()))
                    self._deactivate(data, deactivated)
                    continue
                if not self._is_unsettled(data, family, point, variables):
                    self.used |= variables.keys()
                elif data.equality:
                    pending.append((id(point[0]), data, self._unknowns(variables, point)))
                else:
                    inequalities.append((data, set(variables)))
        self._refuse_missing_equations(pending)
        self._settle_start(pending, inequalities, deactivated)
        if self._refused is not None:
            raise self._refused
        self._check_fixed()

    @staticmethod
    def _deactivate(data: Any, deactivated: list[Any]) -> None:
        data.deactivate()
        deactivated.append(data)

    # ---------------------------------------------------------------- single rows

    def _variables_inside(self, component: Any, rows: list[Any]) -> set[int]:
        """Ids of the variables of rows that hold in any case."""
        candidates = self.values.candidates
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
        if data.ctype is not Constraint or not data.equality or self.values.is_first(*point):
            return False
        if not self.values.candidates.keys().isdisjoint(variables):
            return False
        return self.values.conditions.isdisjoint(variables) and family in self._families_along()

    def _is_unsettled(self, data: Any, family: Any, point: tuple[Any, float], variables: dict[int, Any]) -> bool:
        """True for a row of which the others have to be known to decide on it.

        These are rows with candidates for a value, and equations at the first point of a set that may be one too many:
        those with a variable that the user has fixed there, and, where there are several sets, those that hold at the
        collocation points as well, such as a boundary condition at the initial time.
        """
        if data.ctype is not Constraint:
            return False
        if not self.values.candidates.keys().isdisjoint(variables):
            return True
        if not data.equality or not self.values.is_first(*point):
            return False
        return not self.values.conditions.isdisjoint(variables) or (
            self.values.several and family in self._families_along()
        )

    def _unknowns(self, variables: dict[int, Any], point: tuple[Any, float]) -> list[Any]:
        """The variables of a row that it may determine: no state but at the first point of a set."""
        known = () if self.values.is_first(*point) else variables.keys() - self.values.candidates.keys()
        return [variable for key, variable in variables.items() if key not in known and not variable.fixed]

    def _families_along(self) -> set[Any]:
        """The families of rows that hold at collocation points."""
        if self._along is None:
            self._along = {
                spot.family(index, axes)
                for spot in self._spots
                if spot.component.ctype is Constraint and not spot.component.is_reference()
                for axes in [axes_of(spot.component)]
                if axes or spot.outer
                for index in spot.component
                if self.values.outside(spot.points(index, axes)) is None
            }
        return self._along

    def _is_stated(self, data: Any) -> bool:
        """True for a row of the user's; False for one that defines a derivative, by this package or by pyomo.dae."""
        component = data.parent_component()
        return id(component) not in self._generated and not component.local_name.endswith("_disc_eq")

    # ---------------------------------------------------------------- generated rows

    def _pending_generated(self, rows: Any) -> list[Pending]:
        """The rows that hold candidates, with their variables; of two joints at one point one is deleted."""
        pending, candidates, axes = [], self.values.candidates, axes_of(rows)
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

    def _refuse_missing_equations(self, pending: list[Pending]) -> None:
        """Raise a `ModelError` where a derivative has an equation at some collocation points of a line only."""
        waiting = {id(v) for _, data, variables in pending if self._is_stated(data) for v in variables}
        stated = self.used | self._dropped | waiting
        for discretisation in self._discretisations.values():
            points, states = frozenset(discretisation.grid.points), set(map(id, discretisation.states))
            for _, rate in discretisation.derivatives:
                axes = axes_of(rate)
                if id(rate) in states or any(id(axis.domain) in self.values.open_ids for axis in axes):
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

    def _settle_start(
        self, pending: list[Pending], inequalities: list[tuple[Any, set[int]]], deactivated: list[Any]
    ) -> None:
        """Decide on the rows at the first points of sets, and which variables there have a value."""
        candidates, determined = self.values.candidates, set[int]()
        for key, discretisation in self._discretisations.items():
            own = [(data, variables) for where, data, variables in pending if where == key]
            if not own:
                continue
            answers = rows_that_hold(own, self._conditions(own, discretisation), candidates.keys() - determined)
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
            self.values.absent[key] = candidates[key]
            if key in self._users and not self._is_initial_condition(key):
                self._refused = self._refused or self.values.refusal(self._users[key], candidates[key][0])
        self.used |= determined

    def _is_initial_condition(self, key: int) -> bool:
        """True, and noted, for a variable in an equation of its own at the first point, which others there can meet.

        An equation of controls alone is none: nothing else would know of it.
        """
        row, (_, domain, time) = self._users[key], self.values.candidates[key]
        if row.ctype is not Constraint or not row.equality or not self.values.is_first(domain, time):
            return False
        rows = [[id(variable) for variable in variables] for _, variables in self.undetermined]
        derivatives = [k for k, (data, _, _) in self.values.candidates.items() if self._is_rate(data)]
        known = columns_that_rows_give(rows, [*derivatives, *self.values.candidates])
        known |= self._discretisations[id(domain)].state_ids()
        if known.isdisjoint(map(id, variables_of_row(row))):
            return False
        self.asked_for.add(key)
        return True

    def _is_initial(self, variables: list[Any]) -> bool:
        """Whether the candidates among variables stand at the first point of a set."""
        places = (self.values.candidates.get(id(variable)) for variable in variables)
        return all(place is None or self.values.is_first(*place[1:]) for place in places)

    def _is_free_rate(self, data: Any) -> bool:
        return self._is_rate(data) and not data.fixed and data.lower is None and data.upper is None

    def _is_rate(self, data: Any) -> bool:
        component = data.parent_component()
        return any(component is rate for one in self._discretisations.values() for _, rate in one.derivatives)

    def _conditions(self, pending: list[tuple[Any, list[Any]]], discretisation: Discretisation) -> list[list[Any]]:
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
        rates = {key for key in ids - definitions.keys() if self._is_free_rate(self.values.absent[key][0])}
        rest = [[id(v) for v in variables_of_row(row) if id(v) in rates] for row in part if id(row) not in explicit]
        is_square = len(rest) == len(rates) == len(columns_that_rows_give(rest, rates))
        return (
            rates
            if is_square and self.asked_for.isdisjoint(ids) and ids - rates <= sources | definitions.keys()
            else set()
        )

    def what_follows(self, rows: Iterable[Any], ids: Collection[int]) -> tuple[Any, ...]:
        """The variables of rows that have these ids, or that the user has fixed at their points."""
        ids = {*ids, *self.values.fixed_rates, *self.values.conditions}
        return tuple({id(v): v for row in rows for v in variables_of_row(row) if id(v) in ids}.values())

    def _check_fixed(self) -> None:
        used = set(self.used)
        for row, variables in self.undetermined:
            if self._is_initial(variables):
                used |= {id(variable) for variable in variables_of_row(row)}
        for key, data in self.values.fixed_rates.items():
            component = data.parent_component()
            axes = tuple(axis for axis in axes_of(component) if id(axis.domain) in self._discretisations)
            line = [component[axis.join(axis.others(data.index()), t)] for axis in axes for t in axis.domain]
            # Where nothing else along the set holds the derivative either, the number is not part of any statement.
            if key not in used and any(id(point) in used and not point.fixed for point in line):
                raise ModelError(
                    f"'{data.name}': is fixed, but no equation that holds at that point has it. State the condition in "
                    "states alone, index the equation by the whole set, or choose lobatto."
                )
