"""Records of how the continuous sets of a model were discretised."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from pyomo.common.collections import ComponentMap
from pyomo.core.base.block import Block

from pyrobocop_pyomo.numerics import Grid


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
    states : list of Var
        The variables that have a value at every time of the grid.
    derivatives : list of (Var, Var)
        Each state with the variable that is its derivative.
    rows : ComponentMap
        From each derivative to its collocation rows; for schemes whose last stage is not the end, also to those at
        element ends.
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
    states: list[Any] = field(default_factory=list)
    derivatives: list[tuple[Any, Any]] = field(default_factory=list)
    rows: Any = field(default_factory=ComponentMap)

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
