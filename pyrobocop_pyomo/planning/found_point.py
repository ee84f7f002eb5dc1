"""A point that was found on a model, taken away from it and loaded again when it is wanted."""

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

# Asked for even where the user declares no suffix, so that the loader can be asked for them.
_ALWAYS_IMPORTED = ("dual", "rc")


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
