"""`PlanningPoint`: the values on a model together with the meshes that they stand on."""

from __future__ import annotations

from typing import Any

from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.phases.remeshing import remesh_phases


class PlanningPoint:
    """Values of the free variables of a model, to be put back later, on whatever mesh its phases are by then.

    Parameters
    ----------
    model : Block
    """

    def __init__(self, model: Any) -> None:
        self._values = VariableValues.of_free(model)
        # By component and index as well: on another mesh and back, variables at times in between are new ones.
        self._named = [
            (variable.parent_component(), variable.index(), number)
            for variable, number in self._values.by_variable.items()
        ]
        self._meshes = {id(phase): (phase, phase.grid.mesh) for phase in phases_of(model.model())}

    def restore(self) -> bool:
        """Put values and meshes back; returns whether a mesh was another one, so that separations are new."""
        moved = {phase: mesh for phase, mesh in self._meshes.values() if phase.grid.mesh != mesh}
        if not moved:
            self._values.restore()
            return False
        remesh_phases(moved)
        for component, index, number in self._named:
            if component.parent_block() is not None and index in component and not component[index].fixed:
                component[index].set_value(number, skip_validation=True)
        return True
