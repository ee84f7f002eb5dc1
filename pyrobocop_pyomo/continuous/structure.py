"""The components of a model with respect to its continuous sets, and the variables of their expressions."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from typing import Any, NamedTuple

from pyomo.core.expr import EqualityExpression
from pyomo.dae import ContinuousSet
from pyomo.mpec import Complementarity as MpecComplementarity

from pyrobocop_pyomo.complementarity import Complementarity
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.activity import BLOCK_TYPES
from pyrobocop_pyomo.modeling.in_place_changes import expressions_of
from pyrobocop_pyomo.modeling.shared_nodes import variables_in, variables_in_any

PAIRS = (Complementarity, MpecComplementarity)


class Axis(NamedTuple):
    """A continuous set among the index sets of a component, and its place in the index."""

    domain: Any
    position: int

    def time(self, index: Any) -> Any:
        """The point of the set in an index."""
        return index[self.position] if index.__class__ is tuple else index

    def others(self, index: Any) -> Any:
        """The rest of an index without the point; None if nothing is left."""
        if index.__class__ is not tuple:
            return None
        return index[: self.position] + index[self.position + 1 :]

    def join(self, others: Any, time: Any) -> Any:
        """The index made of the rest and a point."""
        return time if others is None else (*others[: self.position], time, *others[self.position :])


class Spot(NamedTuple):
    """A component, with the blocks around it and their points.

    Attributes
    ----------
    component : Component
    path : tuple of (name, index, axes)
        The blocks around it.
    outer : tuple of (ContinuousSet, point)
        Points that the blocks around it stand at.
    active : bool
        Whether the component and all blocks around it are active.
    """

    component: Any
    path: tuple[Any, ...]
    outer: tuple[tuple[Any, Any], ...]
    active: bool

    def members_along(self, domain: Any) -> Iterator[tuple[tuple[Any, ...], Any, Any]]:
        """Key of the family, point and data of every member that stands at a point of a continuous set."""
        axes = axes_of(self.component)
        around = [time for along, time in self.outer if along is domain]
        own = next((axis for axis in axes if axis.domain is domain), None)
        families: dict[Any, tuple[Any, ...]] = {}  # the key is the same for all points of one
        for index, data in self.component.items() if around or own is not None else ():
            others = index if own is None else own.others(index)
            if others not in families:
                parts = (*self.path, (self.component.local_name, index, axes))
                families[others] = tuple((name, _without(part, along, domain)) for name, part, along in parts)
            for time in around if own is None else (*around, own.time(index)):
                yield families[others], time, data


def axes_of(component: Any) -> tuple[Axis, ...]:
    """The continuous sets among the index sets of a component.

    Raises
    ------
    ModelError
        When one of them comes twice, or comes after a set of unknown dimension.
    """
    if not component.is_indexed():
        return ()
    axes: list[Axis] = []
    position: int | None = 0
    for subset in component.index_set().subsets():
        if subset.ctype is ContinuousSet:
            if position is None:
                raise ModelError(
                    f"'{component.name}': the set before '{subset.name}' among its index sets has no fixed dimension. "
                    "Give that set a dimension, dimen=..."
                )
            if any(axis.domain is subset for axis in axes):
                raise ModelError(
                    f"'{component.name}': is indexed by '{subset.name}' twice, which cannot be discretised. "
                    "Build it after the transformation."
                )
            axes.append(Axis(subset, position))
        dimension = subset.dimen
        position = position + dimension if position is not None and isinstance(dimension, int) else None
    return tuple(axes)


def axis_on(component: Any, domain: Any) -> Axis | None:
    """The axis of a component along one continuous set; None if it has none."""
    return next((axis for axis in axes_of(component) if axis.domain is domain), None)


def spots(
    block: Any, path: tuple[Any, ...] = (), outer: tuple[tuple[Any, Any], ...] = (), active: bool = True
) -> Iterator[Spot]:
    """Every component below a block, in the order of declaration; blocks come before their contents."""
    for component in list(block.component_map().values()):
        is_active = active and getattr(component, "active", True)
        yield Spot(component, path, outer, is_active)
        if component.ctype not in BLOCK_TYPES or component.is_reference():
            continue
        axes = axes_of(component)
        for index, data in list(component.items()):
            inner = ((component.local_name, index, axes),)
            points = tuple((axis.domain, axis.time(index)) for axis in axes)
            yield from spots(data, path + inner, outer + points, is_active and data.active)


def continuous_sets(found: list[Spot]) -> list[Any]:
    """The continuous sets among components."""
    return [spot.component for spot in found if spot.component.ctype is ContinuousSet]


def label(family: tuple[Any, ...]) -> str:
    """A family as people write it: ``x``, ``x[a]``, ``tank[1].level``."""
    parts = []
    for name, others in family:
        indices = others if isinstance(others, tuple) else () if others is None else (others,)
        parts.append(f"{name}[{','.join(map(str, indices))}]" if indices else name)
    return ".".join(parts)


def variables_of_row(data: Any) -> Iterable[Any]:
    """Every variable of a row, an objective, an expression or a pair."""
    for side in (data._args or ()) if data.ctype is MpecComplementarity else expressions_of(data):
        yield from variables_in(side)


def _without(index: Any, axes: tuple[Axis, ...], domain: Any) -> Any:
    """An index without the point of a set."""
    return next((axis.others(index) for axis in axes if axis.domain is domain), index)


def row_variables(rows: Iterable[Any], derivatives: Collection[int]) -> tuple[dict[int, tuple[Any, Any]], set[int]]:
    """Walk over rows, objectives or named expressions, all at once.

    Parameters
    ----------
    rows : iterable of component data
    derivatives : collection of int
        Ids of the variables that may be said explicitly.

    Returns
    -------
    dict of id to (row, expression)
        From a derivative that a row says explicitly, ``dx[t] == f``, to that row and ``f``.
    set of int
        Ids of all variables that the rows hold otherwise.
    """
    given: dict[int, tuple[Any, Any]] = {}
    others: list[Any] = []
    for data in rows:
        expression = data.expr
        if isinstance(expression, EqualityExpression):
            left, right = expression.args
            if id(left) not in derivatives:
                left, right = right, left
            if id(left) in derivatives and id(left) not in given:
                given[id(left)] = (data, right)
                expression = right
        others.append(expression)
    return given, set(variables_in_any(others))
