"""Values that are absent: at points that are no collocation points, only states have one.

Equations hold at collocation points. At the other points of the grid, the first for Radau and every element boundary
for Gauss, states have a value and nothing else has:

* a control, an algebraic or a derivative there is fixed to None, so that whoever uses it learns about it;
* an equation or inequality that holds one of those is deactivated;
* a relation of states alone stays: path constraints at every point, equations at the first (consistency) but not at
  inner boundaries, where there would be more of them than unknowns; conditions that are stated there only stay;
* pairs hold at collocation points only.
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
from .record import Discretisation
from .row_variables import RowVariables, row_variables
from .structure import PAIRS, Axis, Spot, axes_of, variables_of_row


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
        self._absent: dict[int, tuple[Any, Any, float]] = {}
        self._fixed: dict[int, Any] = {}  # derivatives that the user fixed at such points
        self._along: set[Any] | None = None
        self._candidates = {
            key for discretisation in self._discretisations.values() for key in explicit_candidates(discretisation)
        }
        self.in_rows: dict[int, RowVariables] = {}
        self._find()

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
            if not axes and not spot.outer:
                continue
            for index, data in self._with_points_outside(spot, axes):
                for domain, time in spot.points(index, axes):
                    if self._outside([(domain, time)]) is None or id(data) in self._states[id(domain)]:
                        continue
                    if not data.fixed or data.value is None:
                        self._absent[id(data)] = (data, domain, time)
                    elif isinstance(component, DerivativeVar):
                        self._fixed[id(data)] = data

    # ---------------------------------------------------------------- rows

    def deactivate_rows(self, deactivated: list[Any]) -> None:
        """Deactivate the rows and pairs that do not hold, and append them to the list; delete the generated ones.

        Raises
        ------
        TranscriptionError
            When what holds, or an objective, needs a variable that is not there.
        """
        seen: set[int] = set()
        for spot in self._spots:
            component = spot.component
            if component.ctype not in (Constraint, Objective, *PAIRS) or not spot.active or component.is_reference():
                continue
            axes, generated = axes_of(component), id(component) in self._generated
            if generated:
                if len(self._discretisations) > 1:
                    self._delete_generated(component)
                continue
            outside = dict(self._with_points_outside(spot, axes))
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
                    data.deactivate()
                    deactivated.append(data)
                else:
                    seen |= variables.keys()
                    kept.append(data)
            if kept:
                self.in_rows.pop(id(component), None)
        self._check_fixed(seen)
        self._check_equations(seen)

    def _delete_generated(self, rows: Any) -> None:
        for index, data in list(rows.items()):
            if data.active and any(id(variable) in self._absent for variable in variables_of_row(data)):
                del rows[index]

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
                if id(variable) in self._absent:
                    raise self._refusal(data, variable)
                everything.add(id(variable))
        return everything

    def _follows(self, data: Any, family: Any, outside: tuple[Any, float]) -> bool:
        """True for a pair or an equation of states: it holds at the collocation points, so it need not hold here."""
        domain, time = outside
        if data.ctype in PAIRS:
            return True
        if data.ctype is not Constraint or not data.equality or time == self._discretisations[id(domain)].grid.times[0]:
            return False
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
        return family in self._along

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

    def _check_equations(self, seen: set[int]) -> None:
        """A derivative that has an equation somewhere needs one at every collocation point."""
        for discretisation in self._discretisations.values():
            states = self._states[id(discretisation.domain)]
            for _, derivative in discretisation.derivatives:
                missing, found = None, False
                for data in derivative.values():
                    if id(data) in seen:
                        found = True
                    elif not data.fixed and id(data) not in self._absent and id(data) not in states:
                        missing = data
                if found and missing is not None:
                    raise TranscriptionError(
                        f"'{missing.name}': has no equation, though the same derivative has one at other points. Index "
                        f"the constraint by '{discretisation.domain.local_name}' itself, not by a list of its points."
                    )

    # ---------------------------------------------------------------- variables

    def clear_variables(self) -> list[tuple[Any, float | None]]:
        """Fix the absent variables to None; returns them with their previous values."""
        cleared = [(data, data.value) for data, _, _ in self._absent.values()]
        for data, _ in cleared:
            data.fix(None, skip_validation=True)
            data.stale = True
        return cleared
