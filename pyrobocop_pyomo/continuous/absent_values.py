"""Values that are absent: at points that are no collocation points, only states have one.

Equations hold at collocation points. At the other points of the grid, the first for Radau and every element boundary
for Gauss, states have a value and nothing else has:

* a control, an algebraic or a derivative there is fixed to None, so that whoever uses it learns about it;
* an equation or inequality that holds one of those is deactivated;
* a relation of states alone stays: path constraints at every point, equations at the first (consistency) but not at
  inner boundaries, where there would be more of them than unknowns; conditions that are stated there only stay;
* pairs hold at collocation points only.

With several sets there is more to say. A derivative along space has a value at the initial time where the model
determines it (`start_values`); an equation may be missing at the ends of space (`line_ends`); and what is indexed by a
set that nothing has discretised yet is left as it is, since whoever discretises that set will look at it again.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.base.var import Var
from pyomo.dae import DerivativeVar

from pyrobocop_pyomo.errors import TranscriptionError

from .derivatives import explicit_candidates
from .line_ends import find_line_ends
from .record import Discretisation, open_sets
from .row_variables import RowVariables, row_variables
from .start_values import rows_that_hold
from .structure import PAIRS, Axis, Spot, axes_of, axis_on, continuous_sets, variables_of_row


class AbsentValues:
    """The variables without a value on the grids of a model's discretised sets, and the rows that hold them.

    Parameters
    ----------
    spots : list of Spot
        All components of the model.
    discretisations : iterable of Discretisation

    Attributes
    ----------
    in_rows : dict of id to RowVariables
        What the constraints hold whose rows were all looked at; see `deactivate_rows`.
    """

    def __init__(self, spots: list[Spot], discretisations: Iterable[Discretisation]) -> None:
        self._spots = spots
        self._discretisations = {id(discretisation.domain): discretisation for discretisation in discretisations}
        self._points = {
            key: frozenset(discretisation.grid.points) for key, discretisation in self._discretisations.items()
        }
        self._states = {key: discretisation.state_ids() for key, discretisation in self._discretisations.items()}
        self._generated = {
            id(rows)
            for discretisation in self._discretisations.values()
            for rows in discretisation.generated_constraints()
        }
        self._joints = {
            id(rows): key for key, discretisation in self._discretisations.items() for rows in discretisation.joints
        }
        self._absent: dict[int, tuple[Any, Any, float]] = {}
        self._at_start: dict[int, tuple[Any, Any, float]] = {}  # derivatives along space, which may have a value there
        self._fixed: dict[int, Any] = {}  # derivatives that the user fixed at such points
        self._dropped: set[int] = set()  # ids of variables in rows that do not hold
        self._along: set[Any] | None = None
        sets = continuous_sets(spots)
        self._open, self._several = open_sets(sets), len(sets) > 1
        self._candidates = {
            key
            for discretisation in self._discretisations.values()
            for key in explicit_candidates(discretisation, self._open)
        }
        self.in_rows: dict[int, RowVariables] = {}
        self._refused: TranscriptionError | None = None
        self._roots = self._roots_of_derivatives()
        self._find()

    def _roots_of_derivatives(self) -> dict[int, tuple[Any, tuple[Any, ...]]]:
        """For each derivative the variable that it is one of, and the sets along which."""
        roots = {
            id(spot.component): (spot.component.get_state_var(), tuple(spot.component.get_continuousset_list()))
            for spot in self._spots
            if isinstance(spot.component, DerivativeVar)
        }
        for discretisation in self._discretisations.values():
            for state, rate in discretisation.derivatives:
                root, _ = roots.get(id(state), (state, ()))
                roots.setdefault(id(rate), (root, (discretisation.domain,)))
        return roots

    def _waits(self, spot: Spot, axes: tuple[Axis, ...]) -> bool:
        """True for what is indexed by a set that is still to be discretised."""
        return bool(self._open) and any(
            id(domain) in self._open
            for domain in (*(along for along, _ in spot.outer), *(axis.domain for axis in axes))
        )

    def _outside(self, points: Iterable[tuple[Any, Any]]) -> tuple[Any, float] | None:
        """The first set with a point that is no collocation point, and that point."""
        for domain, time in points:
            if id(domain) in self._points and time not in self._points[id(domain)]:
                return domain, time
        return None

    def _with_points_outside(self, spot: Spot, axes: tuple[Axis, ...]) -> Iterable[tuple[Any, Any]]:
        """Index and data of each member with a point that is no collocation point."""
        if self._outside(spot.outer) is not None:
            return list(spot.component.items())
        known = [(axis, self._points[id(axis.domain)]) for axis in axes if id(axis.domain) in self._points]
        return [
            (index, data)
            for index, data in spot.component.items()
            if any(axis.time(index) not in points for axis, points in known)
        ]

    def _find(self) -> None:
        for spot in self._spots:
            component = spot.component
            if component.ctype not in (Var, DerivativeVar) or component.is_reference():
                continue
            axes = axes_of(component)
            if (not axes and not spot.outer) or self._waits(spot, axes):
                continue
            for index, data in self._with_points_outside(spot, axes):
                missing = [
                    (domain, time)
                    for domain, time in spot.points(index, axes)
                    if self._outside([(domain, time)]) is not None
                    and not self._has_value(component, index, data, domain)
                ]
                if not missing:
                    continue
                (domain, time) = missing[0]
                if data.fixed and data.value is not None:
                    if isinstance(component, DerivativeVar):
                        self._fixed[id(data)] = data
                elif all(self._may_have_value(component, index, *place) for place in missing):
                    self._at_start[id(data)] = (data, domain, time)
                else:
                    self._absent[id(data)] = (data, domain, time)
            self._find_last(component, axes)

    def _has_value(self, component: Any, index: Any, data: Any, domain: Any) -> bool:
        """Whether a variable has a value at a point of a set that is no collocation point."""
        if id(data) in self._states[id(domain)]:
            return True
        discretisation = self._discretisations[id(domain)]
        axis = axis_on(component, domain)
        if not discretisation.from_left or axis is None or axis.time(index) != discretisation.grid.times[0]:
            return False
        if any(component is rate for _, rate in discretisation.derivatives):
            return discretisation.ends_of(component, axis.others(index)).from_left
        return True

    def _may_have_value(self, component: Any, index: Any, domain: Any, time: float) -> bool:
        """Whether a variable is a derivative, along another set, of a state at the first point of a set."""
        root, along = self._roots.get(id(component), (None, ()))
        if root is None or any(other is domain for other in along) or index not in root:
            return False
        return time == self._discretisations[id(domain)].grid.times[0] and id(root[index]) in self._states[id(domain)]

    def _find_last(self, component: Any, axes: tuple[Axis, ...]) -> None:
        """Derivatives whose equation holds at the first point of a set have no value at the last."""
        for axis in axes:
            discretisation = self._discretisations.get(id(axis.domain))
            if discretisation is None or component not in discretisation.ends:
                continue
            last, known = discretisation.grid.times[-1], discretisation.ends[component]
            for index, data in component.items():
                fixed = data.fixed and data.value is not None
                if axis.time(index) == last and known.of(axis.others(index)).from_left and not fixed:
                    self._absent[id(data)] = (data, axis.domain, last)

    # ---------------------------------------------------------------- rows

    def deactivate_rows(self, deactivated: list[Any]) -> bool:
        """Deactivate the rows and pairs that do not hold, and append them to the list; delete the generated ones.

        Returns
        -------
        bool
            False when equations are missing at the ends of a set otherwise than the rows were written for. Then
            `Discretisation.ends` say how, and everything has to be done once more.

        Raises
        ------
        TranscriptionError
            When what holds, or an objective, needs a variable that is not there.
        """
        seen: set[int] = set()
        pending: list[tuple[int, Any, list[Any]]] = []
        for spot in self._spots:
            component = spot.component
            if component.ctype not in (Constraint, Objective, *PAIRS) or not spot.active or component.is_reference():
                continue
            axes, generated = axes_of(component), id(component) in self._generated
            if generated:
                if len(self._discretisations) > 1:
                    pending += self._delete_generated(component)
                continue
            waits = self._waits(spot, axes)
            outside = {} if waits else dict(self._with_points_outside(spot, axes))
            inside = [data for index, data in component.items() if index not in outside and data.active]
            seen |= self._held(component, inside)
            kept: list[Any] = []
            for index, data in outside.items():
                if not data.active:
                    continue
                variables = {id(variable): variable for variable in variables_of_row(data)}
                point = self._outside(spot.points(index, axes))
                assert point is not None
                if not self._absent.keys().isdisjoint(variables) or self._follows(
                    data, spot.family(index, axes), point
                ):
                    self._dropped |= variables.keys()
                    data.deactivate()
                    deactivated.append(data)
                    continue
                if self._is_unsettled(data, spot.family(index, axes), point, variables):
                    pending.append((id(point[0]), data, [v for v in variables.values() if not v.fixed]))
                else:
                    seen |= variables.keys()
                kept.append(data)
            if kept:
                self.in_rows.pop(id(component), None)
        if not self._settle_ends(seen):
            return False
        if pending or self._at_start:
            seen |= self._settle_start(pending, deactivated, seen)
        if self._refused is not None:
            raise self._refused
        self._check_fixed(seen)
        return True

    def _is_unsettled(self, data: Any, family: Any, point: tuple[Any, float], variables: Iterable[int]) -> bool:
        """True for a row at the first point of a set of which the others have to be known to decide on it.

        These are rows with derivatives along space, and, where there are several sets, equations that hold at the
        collocation points as well: a boundary condition at the initial time may be one too many there.
        """
        if not self._at_start.keys().isdisjoint(variables):
            return True
        domain, time = point
        return (
            self._several
            and data.ctype is Constraint
            and data.equality
            and time == self._discretisations[id(domain)].grid.times[0]
            and family in self._families_along()
        )

    def _delete_generated(self, rows: Any) -> list[tuple[int, Any, list[Any]]]:
        """Delete the rows that hold absent values; returns those that may hold, with their variables."""
        pending = []
        is_joint, axes = id(rows) in self._joints, axes_of(rows)
        for index, data in list(rows.items()):
            if is_joint and self._is_second_joint(id(rows), index, axes):
                del rows[index]
                continue
            variables = {id(variable): variable for variable in variables_of_row(data)} if data.active else {}
            if not self._absent.keys().isdisjoint(variables):
                del rows[index]
            elif not self._at_start.keys().isdisjoint(variables):
                place = next(id(self._at_start[key][1]) for key in variables if key in self._at_start)
                pending.append((place, data, [variable for variable in variables.values() if not variable.fixed]))
        return pending

    def _is_second_joint(self, key: int, index: Any, axes: tuple[Axis, ...]) -> bool:
        """True where elements of an earlier set end as well: its row gives the value there already."""
        for domain, discretisation in self._discretisations.items():
            if domain == self._joints[key]:
                return False
            times = [axis.time(index) for axis in axes if id(axis.domain) == domain]
            if discretisation.joints and any(time in discretisation.grid.mesh.boundaries[1:] for time in times):
                return True
        return False

    def _settle_ends(self, seen: set[int]) -> bool:
        """Find out where derivatives have equations; False when that is news."""
        settled = True
        stated = seen | self._dropped
        for discretisation in self._discretisations.values():
            ends = find_line_ends(
                discretisation, lambda data: id(data) in stated or (data.fixed and data.value is not None), self._open
            )
            settled = settled and list(ends.items()) == list(discretisation.ends.items())
            discretisation.ends = ends
        return settled

    def _settle_start(
        self, pending: list[tuple[int, Any, list[Any]]], deactivated: list[Any], seen: set[int]
    ) -> set[int]:
        """Decide which derivatives along space have a value at the start; returns the variables of rows that hold."""
        held: set[int] = set()
        for key, discretisation in self._discretisations.items():
            own = [(data, variables) for where, data, variables in pending if where == key]
            conditions = self._conditions(own, discretisation) if own else ()
            needed = seen | {id(v) for data, variables in own if self._is_stated(data) for v in variables}
            for (data, variables), holds in zip(
                own, rows_that_hold(own, conditions, needed, set(self._at_start)), strict=True
            ):
                ids = {id(variable) for variable in variables}
                if holds:
                    held |= ids
                elif id(data.parent_component()) in self._generated:
                    del data.parent_component()[data.index()]
                else:
                    data.deactivate()
                    deactivated.append(data)
        for key in self._at_start.keys() - held - seen:
            self._absent[key] = self._at_start[key]
        return held

    def _is_stated(self, data: Any) -> bool:
        """True for a row of the user's; False for one that defines a derivative, by this package or by pyomo.dae."""
        component = data.parent_component()
        return id(component) not in self._generated and not component.local_name.endswith("_disc_eq")

    def _conditions(self, pending: list[tuple[Any, list[Any]]], discretisation: Discretisation) -> list[list[Any]]:
        """The variables of equations that hold at the first point of a set in any case."""
        rows = {id(data) for data, _ in pending}
        points = self._points[id(discretisation.domain)]
        found = []
        for spot in self._spots:
            if spot.component.ctype is not Constraint or not spot.active or spot.component.is_reference():
                continue
            axes = axes_of(spot.component)
            for index, data in spot.component.items():
                if not data.active or not data.equality or id(data) in rows:
                    continue
                if any(along is discretisation.domain and time in points for along, time in spot.points(index, axes)):
                    continue
                found.append(list({id(v): v for v in variables_of_row(data) if not v.fixed}.values()))
        return found

    def _held(self, component: Any, rows: list[Any]) -> set[int]:
        """Ids of the variables of rows at collocation points; none of them may be absent."""
        if component.ctype not in PAIRS:
            held = row_variables(rows, self._candidates)
            everything = held.elsewhere | held.given.keys()
            if self._absent.keys().isdisjoint(everything):
                self.in_rows[id(component)] = held
                return everything
        everything = set()
        for data in rows:
            for variable in variables_of_row(data):
                if id(variable) in self._absent and self._refused is None:
                    self._refused = self._refusal(data, variable)
                everything.add(id(variable))
        return everything

    def _follows(self, data: Any, family: Any, outside: tuple[Any, float]) -> bool:
        """True for a pair or an equation of states: it holds at the collocation points, so it need not hold here."""
        domain, time = outside
        if data.ctype in PAIRS:
            return True
        if data.ctype is not Constraint or not data.equality or time == self._discretisations[id(domain)].grid.times[0]:
            return False
        return family in self._families_along()

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
                if self._outside(spot.points(index, axes)) is None
            }
        return self._along

    def _refusal(self, data: Any, absent: Any) -> TranscriptionError:
        _, domain, time = self._absent[id(absent)]
        scheme = self._discretisations[id(domain)].grid.scheme
        return TranscriptionError(
            f"'{data.name}': holds '{absent.name}', but {scheme.name} has no collocation point at "
            f"{domain.local_name} = {time:g}: only states have a value there. Leave that point out, write an Integral "
            f"for a sum over '{domain.local_name}', or choose a scheme with a point there: radau has one at the end, "
            "lobatto at both ends."
        )

    # ---------------------------------------------------------------- checks

    def _check_fixed(self, seen: set[int]) -> None:
        for key, data in self._fixed.items():
            component = data.parent_component()
            if key not in seen and not all(point.fixed for point in component.values()):
                raise TranscriptionError(
                    f"'{data.name}': is fixed, but every row that holds it holds an algebraic or control as well, "
                    "which has no value at that point. State the condition in states alone, or choose lobatto."
                )

    # ---------------------------------------------------------------- variables

    def clear_variables(self) -> list[tuple[Any, float | None]]:
        """Fix the absent variables to None; returns them with their previous values."""
        cleared = [(data, data.value) for data, _, _ in self._absent.values()]
        for data, _ in cleared:
            data.fix(None, skip_validation=True)
            data.stale = True
        return cleared
