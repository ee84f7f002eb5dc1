"""Records of how the continuous sets of a model were discretised."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from pyomo.common.autoslots import AutoSlots
from pyomo.common.collections import ComponentMap
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint

from pyrobocop_pyomo.numerics import Grid

from .row_variables import RowVariables


@dataclass(eq=False)
class Substitution:
    """A derivative that an expression replaces, where it belongs, its rows and its values."""

    parent: Any
    name: str
    derivative: Any
    expression: Any
    rows: list[Any]
    values: list[tuple[Any, float | None]]


class LineEnds(NamedTuple):
    """Where the equation of one derivative along a set is missing at an end of the set.

    Attributes
    ----------
    from_left : bool
        The equation holds at the first point and not at the last: the rows are those of the left ends of elements.
    without : tuple of float
        Collocation points without an equation: the derivative there is that of the points beside it.
    """

    from_left: bool = False
    without: tuple[float, ...] = ()


class DerivativeEnds(NamedTuple):
    """The ends of one derivative along a set.

    Attributes
    ----------
    lines : dict of index to LineEnds
        By the other indices of the derivative.
    elsewhere : LineEnds
        For other indices that come later.
    """

    lines: dict[Any, LineEnds]
    elsewhere: LineEnds

    def of(self, others: Any) -> LineEnds:
        """The ends for one choice of the other indices."""
        return self.lines.get(others, self.elsewhere)


@dataclass(eq=False)
class Discretisation:
    """The discretisation of one continuous set, with all that is needed to undo it.

    Attributes
    ----------
    domain : ContinuousSet
    grid : Grid
    points : tuple of float
        The points that the set had before.
    substitutes : bool
        Whether right-hand sides take the place of derivatives.
    generated : list of Block
        Blocks with the collocation rows, one beside each group of derivatives.
    deactivated : list of component data
        Rows and pairs of the user's that were deactivated because they stand at no collocation point.
    cleared : list of (variable, value)
        Variables of the user's without a value of their own, because they stand at no collocation point.
    shown : list of (variable, variable, tuple of variable)
        Variables among those without a value of their own, the one whose value they show, and what follows from it.
    initialised : list of Var
        Derivatives that had no value and were given an initial one.
    formulas : list of (integral, expression)
        What integrals were before.
    substitutions : list of Substitution
    states : list of Var
        The variables that have a value at every time of the grid.
    derivatives : list of (Var, Var)
        Each state with the variable that is its derivative.
    rows : ComponentMap
        From each derivative to its collocation rows.
    joints : list of (Var, Constraint)
        Each state with the rows at element ends, for schemes whose last stage is not the end.
    ends : ComponentMap
        From a derivative to its `DerivativeEnds`, where equations are missing at an end.
    deferred : list of (Var, Var)
        Each state with its derivative, where the rows are still to be written.
    in_rows : dict of id to RowVariables
        What constraints hold, by their ids, until the discretisation is finished.
    """

    domain: Any
    grid: Grid
    points: tuple[float, ...]
    substitutes: bool = True
    generated: list[Any] = field(default_factory=list)
    deactivated: list[Any] = field(default_factory=list)
    cleared: list[tuple[Any, float | None]] = field(default_factory=list)
    shown: list[tuple[Any, Any, tuple[Any, ...]]] = field(default_factory=list)
    initialised: list[Any] = field(default_factory=list)
    formulas: list[tuple[Any, Any]] = field(default_factory=list)
    substitutions: list[Substitution] = field(default_factory=list)
    states: list[Any] = field(default_factory=list)
    derivatives: list[tuple[Any, Any]] = field(default_factory=list)
    rows: Any = field(default_factory=ComponentMap)
    joints: list[tuple[Any, Any]] = field(default_factory=list)
    ends: Any = field(default_factory=ComponentMap)
    deferred: list[tuple[Any, Any]] = field(default_factory=list)
    in_rows: dict[int, RowVariables] = field(default_factory=dict)

    def state_ids(self) -> set[int]:
        """The ids of all variables that have a value at every time of the set."""
        return {id(data) for state in self.states for data in state.values()}

    def ends_of(self, derivative: Any, others: Any) -> LineEnds:
        """Where the equation of a derivative is missing, for one choice of its other indices."""
        known = self.ends.get(derivative)
        return LineEnds() if known is None else known.of(others)

    @property
    def from_left(self) -> bool:
        """True when some equations hold at the first point of the set, though the scheme has no stage there."""
        return any(known.elsewhere.from_left for known in self.ends.values())

    def generated_constraints(self) -> Iterator[Any]:
        """The generated constraints of the set."""
        for block in self.generated:
            yield from block.component_map(Constraint).values()


class DiscretisationRecord(AutoSlots.Mixin):
    """Private data of the block on which continuous sets live; follows clones and pickles.

    Attributes
    ----------
    discretisations : ComponentMap
        From a continuous set to its `Discretisation`.
    integrands : ComponentMap
        From an integral to the rule of its integrand.
    """

    __slots__ = ("discretisations", "integrands")

    def __init__(self) -> None:
        self.discretisations = ComponentMap()
        self.integrands = ComponentMap()


Block.register_private_data_initializer(DiscretisationRecord)


def discretisation_record_of(domain: Any) -> DiscretisationRecord:
    """The record of the block on which a continuous set lives."""
    return domain.parent_block().private_data()


def discretisation_of(domain: Any) -> Discretisation | None:
    """The discretisation of a continuous set; None if there is none."""
    return discretisation_record_of(domain).discretisations.get(domain)


def discretisations_of(domains: Any) -> Iterator[Discretisation]:
    """The discretisations of those sets that this package has discretised."""
    for domain in domains:
        discretisation = discretisation_of(domain)
        if discretisation is not None:
            yield discretisation


def open_sets(domains: Any) -> set[int]:
    """The ids of those continuous sets that nothing has discretised yet."""
    return {
        id(domain)
        for domain in domains
        if discretisation_of(domain) is None and "scheme" not in domain.get_discretization_info()
    }
