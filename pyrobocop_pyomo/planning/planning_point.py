"""Points that were found on a model, to be put back when they are wanted."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

from pyomo.core.base.block import BlockData
from pyomo.core.base.enums import TraversalStrategy
from pyomo.core.base.suffix import Suffix
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.obstacles import avoidance_blocks, containments
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.phases.remeshing import put_on_meshes

logger = logging.getLogger(__name__)


class PlanningPoint:
    """Values of free variables and imported suffixes of a model, to be put back later, whatever its meshes are then.

    The margins and norms of separations among obstacles, and the margins inside regions, come back with them.

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
        self._blocks = [
            (block, {index: value(block.margin[index]) for index in block.separations}, block.record.norm_now)
            for block in avoidance_blocks(model)
        ]
        self._regions = [
            (region, {time: value(region.margin[time]) for time in region.times}) for region in containments(model)
        ]

    def restore(self) -> None:
        """Put values, meshes and margins back; planes that are new by now start at the point."""
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
        for block, margins, norm in self._blocks:
            for index in block.separations:
                block.margin[index] = margins.get(index, 0.0)
            try:
                if moved or set(block.separations) != set(margins):
                    block.initialize()
                else:
                    block.set_norm(norm)
            except ObstacleError as error:  # the point itself counts without their start values
                logger.warning("the separations of '%s' have no start values at the best point: %s", block.name, error)
        for region, room in self._regions:
            region.margin.store_values(room)


def _named(entries: Mapping[Any, Any]) -> list[tuple[Any, Any, Any]]:
    """Component, index and entry of each part of a model that has an entry."""
    return [
        (part.parent_component(), part.index(), entry)
        for part, entry in entries.items()
        if hasattr(part, "parent_component") and part.parent_component() is not None
    ]


def imported_suffixes(model: BlockData) -> list[Suffix]:
    """Suffixes for import, those nearest to the root first."""
    found = model.component_objects(
        Suffix, active=True, descend_into=True, descent_order=TraversalStrategy.BreadthFirstSearch
    )
    return [suffix for suffix in found if suffix.import_enabled()]
