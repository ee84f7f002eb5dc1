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
from .structure import Axis, Spot, axes_of, continuous_sets


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
        self.fixed_rates: dict[int, Any] = {}
        self.conditions: set[int] = set()
        sets = continuous_sets(spots)
        self.open_ids = open_sets(sets)
        self.several = len(sets) > 1
        self._find()

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
                    if self.outside([(domain, time)]) is not None and id(data) not in self._states[id(domain)]
                ]
                if missing:
                    self._file(spot, index, data, missing)

    def _file(self, spot: Spot, index: Any, data: Any, missing: list[tuple[Any, float]]) -> None:
        component = spot.component
        if data.fixed and data.value is not None:
            if isinstance(component, DerivativeVar):
                self.fixed_rates[id(data)] = data
            elif not component.is_indexed() or not all(other.fixed for other in component.values()):
                self.conditions.add(id(data))
            return
        self.candidates[id(data)] = (data, *missing[0])

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
