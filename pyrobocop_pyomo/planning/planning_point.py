"""Points that were found on a model: taken away from it, and put back or loaded again when they are wanted.

`PlanningPoint` keeps values and multipliers together with the meshes that they stand on; `FoundPoint` is a point in the
form of Pyomo's solution loaders.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from pyomo.common.collections import ComponentMap
from pyomo.contrib.solver.common.solution_loader import SolutionLoader
from pyomo.contrib.solver.common.util import NoSolutionError
from pyomo.core.base.block import BlockData
from pyomo.core.base.constraint import ConstraintData
from pyomo.core.base.enums import TraversalStrategy
from pyomo.core.base.suffix import Suffix
from pyomo.core.base.var import VarData

from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.phases.remeshing import put_on_meshes

# Asked for even where the user declares no suffix, so that the loader can be asked for them.
_ALWAYS_IMPORTED = ("dual", "rc")


class PlanningPoint:
    """Values of free variables and imported suffixes of a model, to be put back later, whatever its meshes are then.

    Parameters
    ----------
    model : Block
    """

    def __init__(self, model: Any) -> None:
        self._values = VariableValues.of_free(model)
        # By component and index as well: on another mesh and back, variables and rows at times in between are new ones.
        self._named = _named(self._values.by_variable)
        self._suffixes = [(suffix, _named(suffix)) for suffix in imported_suffixes(model)]
        self._meshes = {id(phase): (phase, phase.grid.mesh) for phase in phases_of(model.model())}

    def restore(self) -> bool:
        """Put values and meshes back; returns whether a mesh was another one, so that separations are new."""
        moved = {phase: mesh for phase, mesh in self._meshes.values() if phase.grid.mesh != mesh}
        if moved:
            put_on_meshes(moved)  # they had them, and nothing has been stated since
            for component, index, number in self._named:
                if component.parent_block() is not None and index in component and not component[index].fixed:
                    component[index].set_value(number, skip_validation=True)
        else:
            self._values.restore()
        for suffix, entries in self._suffixes:
            suffix.clear()
            suffix.update(
                (component[index], entry)
                for component, index, entry in entries
                if component.parent_block() is not None and index in component
            )
        return bool(moved)


def _named(entries: Mapping[Any, Any]) -> list[tuple[Any, Any, Any]]:
    """Component, index and entry of each part of a model that has an entry."""
    return [
        (part.parent_component(), part.index(), entry)
        for part, entry in entries.items()
        if hasattr(part, "parent_component") and part.parent_component() is not None
    ]


class FoundPoint(SolutionLoader):
    """A point with its multipliers, loaded into the model when it is requested.

    Parameters
    ----------
    model : Block
        Holds the point now.
    """

    def __init__(self, model: BlockData) -> None:
        self._pyomo_model = model
        self._values = VariableValues.of_free(model).by_variable
        # Of several with one name, that nearest to the root.
        found = reversed(imported_suffixes(model))
        self._suffixes = {suffix.local_name: ComponentMap(suffix.items()) for suffix in found}

    def get_number_of_solutions(self) -> int:
        """Always one: the best point exists whatever stopped the procedure."""
        return 1

    def get_vars(self, vars_to_load: Sequence[VarData] | None = None) -> Mapping[VarData, float]:
        """Values of variables."""
        return _selected(self._values, vars_to_load)

    def get_duals(self, cons_to_load: Sequence[ConstraintData] | None = None) -> Mapping[ConstraintData, float]:
        """Multipliers of the user's constraints, in the sign of Pyomo's ``dual``.

        Raises
        ------
        NoSolutionError
            Where a component of the name ``dual`` is on the model that is no suffix for import.
        """
        return self._multipliers("dual", cons_to_load)

    def get_reduced_costs(self, vars_to_load: Sequence[VarData] | None = None) -> Mapping[VarData, float]:
        """Multipliers of bounds, in the sign of Pyomo's ``rc``.

        Raises
        ------
        NoSolutionError
            Where a component of the name ``rc`` is on the model that is no suffix for import.
        """
        return self._multipliers("rc", vars_to_load)

    def load_import_suffixes(self) -> None:
        """Fill the suffixes that the model declares for import."""
        for name, suffix in self._collect_and_clear_import_suffixes().items():
            suffix.update(self._suffixes.get(name, {}))

    def _multipliers(self, name: str, wanted: Sequence[Any] | None) -> Mapping[Any, float]:
        entries = self._suffixes.get(name)
        if entries is None:
            raise NoSolutionError(
                f"'{self._pyomo_model.name}': multipliers were not kept, since '{name}' is taken. Make it a "
                "Suffix(direction=Suffix.IMPORT), or free the name."
            )
        return _selected(entries, wanted)


@contextmanager
def multipliers_imported(model: BlockData) -> Iterator[None]:
    """Declare the usual import suffixes where nothing has their names; afterwards they are gone."""
    present = {suffix.local_name for suffix in imported_suffixes(model)}
    added = []
    for name in _ALWAYS_IMPORTED:
        if name not in present and model.component(name) is None and not hasattr(model, name):
            model.add_component(name, Suffix(direction=Suffix.IMPORT))
            added.append(name)
    try:
        yield
    finally:
        for name in added:
            model.del_component(name)


def imported_suffixes(model: BlockData) -> list[Suffix]:
    """Suffixes for import, those nearest to the root first."""
    found = model.component_objects(
        Suffix, active=True, descend_into=True, descent_order=TraversalStrategy.BreadthFirstSearch
    )
    return [suffix for suffix in found if suffix.import_enabled()]


def _selected(entries: ComponentMap, wanted: Sequence[Any] | None) -> ComponentMap:
    return entries if wanted is None else ComponentMap((component, entries[component]) for component in wanted)
