"""`PlanningPoint`: values and multipliers on a model together with the meshes that they stand on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.phases.remeshing import put_on_meshes

from .found_point import imported_suffixes


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
