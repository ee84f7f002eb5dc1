"""What goes in and out of a model by suffixes: multipliers in Pyomo's signs, and scaling factors.

Ipopt's Lagrangian belongs to a minimisation, with every multiplier of a bound not negative. Pyomo's suffixes follow
AMPL: ``dual`` is the change of the objective, as the user stated it, per unit of the row's right-hand side. So with
``sign`` 1 for minimising and -1 for maximising, as the ``ipopt`` executable has it::

    dual = -sign * g_multipliers
    ipopt_zL_out = sign * lower_multipliers
    ipopt_zU_out = -sign * upper_multipliers
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from pyomo.common.collections import ComponentMap
from pyomo.contrib.solver.common.solution_loader import SolutionLoader
from pyomo.contrib.solver.common.util import NoSolutionError
from pyomo.core.base.block import BlockData
from pyomo.core.base.constraint import ConstraintData
from pyomo.core.base.enums import TraversalStrategy
from pyomo.core.base.suffix import Suffix
from pyomo.core.base.var import VarData

from pyrobocop_pyomo.discretisation import RowMultipliers
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, PrimalDualPoint, ProblemScaling

from .ipopt_outcome import IpoptOutcome

# Components, and their numbers; arrays are read when somebody asks.
Entries = tuple[Sequence[Any], Sequence[Any] | FloatArray]


def starting_point(compiled: CompiledModel) -> PrimalDualPoint:
    """The values on the model, with multipliers from its suffixes ``dual``, ``ipopt_zL_in`` and ``ipopt_zU_in``.

    Only suffixes that are declared for export count. Entries that one leaves out are 0, as the ``ipopt`` executable
    reads them.
    """
    sign, model = compiled.sign, compiled.model
    lower = _exported(model, "ipopt_zL_in", compiled.variables)
    upper = _exported(model, "ipopt_zU_in", compiled.variables)
    rows = _exported(model, "dual", compiled.constraints)
    return PrimalDualPoint(
        x=compiled.current_point(),
        g_multipliers=None if rows is None else -sign * rows,
        lower_multipliers=None if lower is None else sign * lower,
        upper_multipliers=None if upper is None else -sign * upper,
    )


def scaling_factors(compiled: CompiledModel, missing: float = 1.0) -> ProblemScaling:
    """The export suffix ``scaling_factor`` of variables, constraints and objective, `missing` where it has none."""
    objective, x, g = (
        np.full(len(components), missing) if stated is None else stated
        for components in ([compiled.objective], compiled.variables, compiled.constraints)
        for stated in [_exported(compiled.model, "scaling_factor", components, missing)]
    )
    return ProblemScaling(float(objective[0]), x, g)


def _exported(model: BlockData, name: str, components: Sequence[Any], missing: float = 0.0) -> FloatArray | None:
    """Values of an export suffix, wherever in the model it is declared; the one closest to the root wins."""
    values: ComponentMap | None = None
    for suffix in model.component_objects(
        Suffix, active=True, descend_into=True, descent_order=TraversalStrategy.BreadthFirstSearch
    ):
        if suffix.local_name == name and suffix.export_enabled():
            values = ComponentMap() if values is None else values
            for component, value in suffix.items():
                if component is None:  # a default for all components: not something that a .nl file can state
                    continue
                for data in component.values() if component.is_indexed() else (component,):
                    values.setdefault(data, value)
    if not values:
        # An empty suffix, as before the first solve, is no statement that all multipliers are zero.
        return None
    return np.array([values.get(component, missing) for component in components], dtype=float)


class FoundPoint(SolutionLoader):
    """A point with its multipliers, loaded into the model when it is requested.

    Parameters
    ----------
    model : Block
    values : pair of sequences
        Variables and their values.
    suffixes : mapping of str to pair of sequences
        What suffixes hold: components and numbers.
    """

    def __init__(self, model: BlockData, values: Entries, suffixes: Mapping[str, Entries]) -> None:
        self._pyomo_model, self._values, self._suffixes = model, values, suffixes

    def get_number_of_solutions(self) -> int:
        """Always one: the last or best point exists whatever stopped the solver."""
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
        """Multipliers of bounds, in the sign of Pyomo's ``rc``: of the two, the one that is larger in size.

        Raises
        ------
        NoSolutionError
            Where a component of the name ``rc`` is on the model that is no suffix for import.
        """
        return self._multipliers("rc", vars_to_load)

    def load_import_suffixes(self) -> None:
        """Fill the suffixes that the model declares for import, as far as they are known here."""
        for name, suffix in self._collect_and_clear_import_suffixes().items():
            if name in self._suffixes:
                suffix.update(_selected(self._suffixes[name]))

    def row_multipliers(self) -> RowMultipliers:
        """Multipliers of rows and bounds, in the signs of Pyomo's suffixes."""
        found = (_by_component(self._suffixes[name]) for name in ("dual", "ipopt_zL_out", "ipopt_zU_out"))
        return RowMultipliers(*({id(part): number for part, number in entries} for entries in found))

    def _multipliers(self, name: str, wanted: Sequence[Any] | None) -> Mapping[Any, float]:
        if name not in self._suffixes:
            raise NoSolutionError(
                f"'{self._pyomo_model.name}': multipliers were not kept, since '{name}' is taken. Make it a "
                "Suffix(direction=Suffix.IMPORT), or free the name."
            )
        return _selected(self._suffixes[name], wanted)


def _by_component(entries: Entries) -> Iterator[tuple[Any, Any]]:
    components, numbers = entries
    return zip(components, numbers.tolist() if isinstance(numbers, np.ndarray) else numbers, strict=True)


def _selected(entries: Entries, wanted: Sequence[Any] | None = None) -> ComponentMap:
    everything = ComponentMap(_by_component(entries))
    return everything if wanted is None else ComponentMap((component, everything[component]) for component in wanted)


class InProcessSolutionLoader(FoundPoint):
    """The last point and multipliers of a run, in terms of the model's components.

    Parameters
    ----------
    compiled : CompiledModel
        What was solved.
    outcome : IpoptOutcome
        What Ipopt returned.
    """

    def __init__(self, compiled: CompiledModel, outcome: IpoptOutcome) -> None:
        self._compiled, self._x, sign = compiled, outcome.x, compiled.sign
        # Adding zero turns -0.0 into 0.0, which reads better in a report.
        lower, upper = sign * outcome.lower_multipliers + 0.0, -sign * outcome.upper_multipliers + 0.0
        larger = np.where(np.abs(upper) > np.abs(lower), upper, lower)
        suffixes: dict[str, Entries] = {
            "dual": compiled.of_model(compiled.constraints, -sign * outcome.g_multipliers),
        }
        for name, numbers in (("rc", larger), ("ipopt_zL_out", lower), ("ipopt_zU_out", upper)):
            suffixes[name] = compiled.of_model(compiled.variables, numbers)
        super().__init__(compiled.model, compiled.of_model(compiled.variables, outcome.x), suffixes)

    def load_vars(self, vars_to_load: Sequence[VarData] | None = None) -> None:
        """Put values into the model's variables."""
        if vars_to_load is None:
            self._compiled.load_point(self._x)
        else:
            super().load_vars(vars_to_load)
