"""The components of a model with respect to its continuous sets, and the variables of their expressions.

Records of how the continuous sets of a model were discretised.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from pyomo.common.collections import ComponentMap
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import ConstraintList
from pyomo.core.expr import EqualityExpression
from pyomo.dae import ContinuousSet
from pyomo.mpec import Complementarity as MpecComplementarity

from pyrobocop_pyomo.complementarity import Complementarity
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.activity import BLOCK_TYPES
from pyrobocop_pyomo.modeling.in_place_changes import expressions_of
from pyrobocop_pyomo.modeling.pyomo_internals import stated_rule
from pyrobocop_pyomo.modeling.rows_by_rule import RowByRule, sums_of
from pyrobocop_pyomo.modeling.shared_nodes import variables_in, variables_in_any
from pyrobocop_pyomo.numerics import Grid

# -------------------------------------------------------------------------------------------------------------- records


@dataclass(eq=False)
class Discretisation:
    """The discretisation of one continuous set, with all that is needed to undo it.

    Attributes
    ----------
    domain : ContinuousSet
    grid : Grid
    points : tuple of float
        The points that the set had before.
    generated : list of Block
        Blocks with the collocation rows, one beside each group of derivatives.
    deactivated : list of component data
        Rows and pairs of the user's that were deactivated because they stand at no collocation point.
    before : list of (variable, value)
        What variables were that have no value of their own, because they stand at no collocation point, and
        derivatives that were given an initial value.
    shown : list of (variable, variable, tuple of variable)
        Variables among those without a value of their own, the one whose value they show, and what follows from it.
    formulas : list of (integral, expression)
        What integrals were before.
    substitutions : ComponentMap
        From each derivative that an expression replaces to this.
    derivatives : list of (Var, Var)
        Each state with the variable that is its derivative.
    homes : ComponentMap
        From each derivative to the generated block for its rows.
    """

    domain: Any
    grid: Grid
    points: tuple[float, ...]
    generated: list[Any] = field(default_factory=list)
    deactivated: list[Any] = field(default_factory=list)
    before: list[tuple[Any, float | None]] = field(default_factory=list)
    shown: list[tuple[Any, Any, tuple[Any, ...]]] = field(default_factory=list)
    formulas: list[tuple[Any, Any]] = field(default_factory=list)
    substitutions: Any = field(default_factory=ComponentMap)
    derivatives: list[tuple[Any, Any]] = field(default_factory=list)
    homes: Any = field(default_factory=ComponentMap)

    @property
    def states(self) -> list[Any]:
        """The variables that have a value at every time of the grid."""
        return [state for state, _ in self.derivatives]

    def state_ids(self) -> set[int]:
        """The ids of all variables that have a value at every time of the set."""
        return {id(data) for state in self.states for data in state.values()}


# Private data of the block on which continuous sets live; follows clones and pickles.
Block.register_private_data_initializer(ComponentMap)


def discretisations_beside(domain: Any) -> Any:
    """From each continuous set of a block that is discretised to its `Discretisation`."""
    return domain.parent_block().private_data()


def discretisation_of(domain: Any) -> Discretisation | None:
    """The discretisation of a continuous set; None if there is none."""
    return discretisations_beside(domain).get(domain)


def open_sets(found: list[Spot]) -> set[int]:
    """The ids of those continuous sets among components that nothing has discretised yet."""
    return {
        id(domain)
        for domain in continuous_sets(found)
        if discretisation_of(domain) is None and "scheme" not in domain.get_discretization_info()
    }


# ------------------------------------------------------------------------------------------------------------ structure


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
        """The index of a component at a point, from the rest of the index that `others` gives."""
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


def rule_of(component: Any) -> Any:
    """The function, or the one value, that the data of a component are made by; None where there is none."""
    if isinstance(component, ConstraintList):
        return None  # never indexed by a set of the user's
    rule = component._init_rule if component.ctype is MpecComplementarity else stated_rule(component)
    return None if rule is None or rule.contains_indices() else rule


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


def _expressions_in(data: Any) -> Sequence[Any]:
    """The expressions of a row, an objective or a pair."""
    return (data._args or ()) if data.ctype is MpecComplementarity else expressions_of(data)


def variables_of_row(data: Any) -> Iterable[Any]:
    """Every variable of a row, an objective, an expression or a pair."""
    for side in _expressions_in(data):
        yield from variables_in(side)


def _without(index: Any, axes: tuple[Axis, ...], domain: Any) -> Any:
    """An index without the point of a set."""
    return next((axis.others(index) for axis in axes if axis.domain is domain), index)


def row_variables(rows: Iterable[Any], derivatives: Collection[int]) -> tuple[dict[int, Any], set[int]]:
    """Walk over rows, objectives, named expressions or pairs, all at once.

    Parameters
    ----------
    rows : iterable of component data
        Of those that follow a rule, which says the same of all of them, the first one is looked at.
    derivatives : collection of int
        Ids of the variables that may be said explicitly.

    Returns
    -------
    dict of id to row
        From a derivative that a row says explicitly, ``dx[t] == f``, to that row.
    set of int
        Ids of all variables that the rows hold otherwise.
    """
    rows = list(rows)
    given: dict[int, Any] = {}
    held: set[int] = set()
    for repeated in sums_of(rows):
        first, otherwise = row_variables([rows[repeated.rows[0]].made()], derivatives)
        for leaves in repeated.variables:
            if id(leaves[0]) in first:
                given |= {id(leaf): rows[i] for i, leaf in zip(repeated.rows, leaves, strict=True)}
            if id(leaves[0]) in otherwise:
                held.update(map(id, leaves))
    others: list[Any] = []
    for data in rows:
        if data.__class__ is RowByRule or data.ctype in PAIRS:
            others += () if data.__class__ is RowByRule else _expressions_in(data)
            continue
        expression = data.expr
        if isinstance(expression, EqualityExpression):
            left, right = expression.args
            if id(left) not in derivatives:
                left, right = right, left
            if id(left) in derivatives and id(left) not in given:
                given[id(left)] = data
                expression = right
        others.append(expression)
    return given, held.union(variables_in_any(others))


def other_side(equation: Any, side: Any) -> Any:
    """What an equation says that one of its sides is."""
    left, right = equation.args
    return right if left is side else left
