"""Values that are absent: at points that are no collocation points, only states have one of their own.

These are the first point for Radau and every element boundary for Gauss. What is missing there is one of three things:

* the user's own: a variable that the user has fixed at this point keeps its value, and is a condition there;
* a candidate: the rows that stand there may determine an algebraic or a derivative (`point_values`), at the first
  point of each set, and at all points where there is one set only;
* absent: it has no row. `shown_values` has a value for it.

What is indexed by a set that nothing has discretised yet is left as it is, since whoever discretises that set will look
at it again.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pyomo.core.base.var import Var
from pyomo.dae import DerivativeVar

from pyrobocop_pyomo.errors import ModelError

from .record import Discretisation, open_sets
from .structure import Axis, Spot, axes_of, axis_on, continuous_sets


class AbsentValues:
    """The variables without a value of their own on the grids of a model's discretised sets.

    Parameters
    ----------
    spots : list of Spot
        All components of the model.
    discretisations : iterable of Discretisation

    Attributes
    ----------
    absent : dict of id to (variable, ContinuousSet, point)
        Variables that no row may hold, and the first point at which they are missing.
    candidates : dict of id to (variable, ContinuousSet, point)
        Variables that the rows at their points may determine.
    along_space : set of int
        Ids of the candidates that are derivatives of a state along another set.
    fixed_rates : dict of id to variable
        Derivatives that the user has fixed at points of this kind.
    conditions : set of int
        Ids of other variables that the user has fixed there, and not everywhere.
    open_ids : set of int
        Ids of the sets that are still to be discretised.
    several : bool
        Whether the model has more than one continuous set.
    """

    def __init__(self, spots: list[Spot], discretisations: Iterable[Discretisation]) -> None:
        self._spots = spots
        self._discretisations = {id(discretisation.domain): discretisation for discretisation in discretisations}
        self._points = {
            key: frozenset(discretisation.grid.points) for key, discretisation in self._discretisations.items()
        }
        self._states = {key: discretisation.state_ids() for key, discretisation in self._discretisations.items()}
        self.absent: dict[int, tuple[Any, Any, float]] = {}
        self.candidates: dict[int, tuple[Any, Any, float]] = {}
        self.along_space: set[int] = set()
        self.fixed_rates: dict[int, Any] = {}
        self.conditions: set[int] = set()
        sets = continuous_sets(spots)
        self.open_ids = open_sets(sets)
        self.several = len(sets) > 1
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

    # ---------------------------------------------------------------- places

    def waits(self, spot: Spot, axes: tuple[Axis, ...]) -> bool:
        """True for what is indexed by a set that is still to be discretised."""
        return bool(self.open_ids) and any(
            id(domain) in self.open_ids
            for domain in (*(along for along, _ in spot.outer), *(axis.domain for axis in axes))
        )

    def outside(self, points: Iterable[tuple[Any, Any]]) -> tuple[Any, float] | None:
        """The first set with a point that is no collocation point, and that point."""
        for domain, time in points:
            if id(domain) in self._points and time not in self._points[id(domain)]:
                return domain, time
        return None

    def members_outside(self, spot: Spot, axes: tuple[Axis, ...]) -> list[tuple[Any, Any]]:
        """Index and data of each member with a point that is no collocation point."""
        if self.outside(spot.outer) is not None:
            return list(spot.component.items())
        known = [(axis, self._points[id(axis.domain)]) for axis in axes if id(axis.domain) in self._points]
        if not known:
            return []
        return [
            (index, data)
            for index, data in spot.component.items()
            if any(axis.time(index) not in points for axis, points in known)
        ]

    def is_first(self, domain: Any, time: float) -> bool:
        """True for the first point of a discretised set."""
        return time == self._discretisations[id(domain)].grid.times[0]

    # ---------------------------------------------------------------- variables

    def _find(self) -> None:
        for spot in self._spots:
            component = spot.component
            if component.ctype not in (Var, DerivativeVar) or component.is_reference():
                continue
            axes = axes_of(component)
            if (not axes and not spot.outer) or self.waits(spot, axes):
                continue
            for index, data in self.members_outside(spot, axes):
                missing = [
                    (domain, time)
                    for domain, time in spot.points(index, axes)
                    if self.outside([(domain, time)]) is not None
                    and not self._has_value(component, index, data, domain)
                ]
                if missing:
                    self._file(spot, index, data, missing)
            self._find_last(component, axes)

    def _file(self, spot: Spot, index: Any, data: Any, missing: list[tuple[Any, float]]) -> None:
        component = spot.component
        if data.fixed and data.value is not None:
            if isinstance(component, DerivativeVar):
                self.fixed_rates[id(data)] = data
            elif not component.is_indexed() or not all(other.fixed for other in component.values()):
                self.conditions.add(id(data))
            return
        place = (data, *missing[0])
        if self.several and not all(self.is_first(*point) for point in missing):
            self.absent[id(data)] = place
            return
        self.candidates[id(data)] = place
        if all(self._is_along_space(component, index, *point) for point in missing):
            self.along_space.add(id(data))

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

    def _is_along_space(self, component: Any, index: Any, domain: Any, time: float) -> bool:
        """Whether a variable is a derivative, along another set, of a state at the first point of a set."""
        root, along = self._roots.get(id(component), (None, ()))
        if root is None or any(other is domain for other in along) or index not in root:
            return False
        return id(root[index]) in self._states[id(domain)]

    def is_like_the_first(self, key: int) -> bool:
        """Whether an absent variable stands at the first point of a set and is no derivative along another grid.

        The rows of such a derivative have gaps at corners; those that pyomo.dae has written for its sets have none.
        """
        data, domain, time = self.absent[key]
        _, along = self._roots.get(id(data.parent_component()), (None, ()))
        return self.is_first(domain, time) and all(
            other is domain or id(other) not in self._discretisations for other in along
        )

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
                    self.absent[id(data)] = (data, axis.domain, last)

    def refusal(self, data: Any, variable: Any) -> ModelError:
        """What to raise where a row that holds in any case needs a variable without a value."""
        _, domain, time = self.absent[id(variable)]
        scheme = self._discretisations[id(domain)].grid.scheme
        return ModelError(
            f"'{data.name}': holds '{variable.name}', but {scheme.name} has no collocation point at "
            f"{domain.local_name} = {time:g}: only states have a value there. Leave that point out, write an Integral "
            f"for a sum over '{domain.local_name}', or choose a scheme with a point there: radau has one at the end, "
            "lobatto at both ends."
        )
