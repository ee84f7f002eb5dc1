"""What goes in and out of a model by suffixes: multipliers in Pyomo's signs, and scaling factors.

Ipopt's Lagrangian is that of a minimisation, with every multiplier of a bound not negative. Pyomo's suffixes follow
AMPL: ``dual`` is the change of the objective, as the user stated it, per unit of the row's right-hand side. So with
``sign`` 1 for minimising and -1 for maximising, as the ``ipopt`` executable has it::

    dual = -sign * g_multipliers
    ipopt_zL_out = sign * lower_multipliers
    ipopt_zU_out = -sign * upper_multipliers
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from pyomo.common.collections import ComponentMap
from pyomo.contrib.solver.common.solution_loader import SolutionLoader
from pyomo.core.base.block import BlockData
from pyomo.core.base.constraint import ConstraintData
from pyomo.core.base.enums import TraversalStrategy
from pyomo.core.base.suffix import Suffix
from pyomo.core.base.var import VarData

from pyrobocop_pyomo.discretisation import RowMultipliers
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, PrimalDualPoint

from .ipopt_outcome import IpoptOutcome
from .ipopt_run import ProblemScaling


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


class InProcessSolutionLoader(SolutionLoader):
    """The last point and multipliers of a run, in terms of the model's components.

    Parameters
    ----------
    compiled : CompiledModel
        What was solved.
    outcome : IpoptOutcome
        What Ipopt returned.
    """

    def __init__(self, compiled: CompiledModel, outcome: IpoptOutcome) -> None:
        self._pyomo_model = compiled.model
        self._compiled = compiled
        self._outcome = outcome

    def get_number_of_solutions(self) -> int:
        """Always one: the last point exists whatever stopped Ipopt."""
        return 1

    def load_vars(self, vars_to_load: Sequence[VarData] | None = None) -> None:
        """Put values into the model's variables."""
        if vars_to_load is None:
            self._compiled.load_point(self._outcome.x)
        else:
            super().load_vars(vars_to_load)

    def get_vars(self, vars_to_load: Sequence[VarData] | None = None) -> Mapping[VarData, float]:
        """Values of variables."""
        return _selected(self._compiled.variables, self._outcome.x, vars_to_load)

    def get_duals(self, cons_to_load: Sequence[ConstraintData] | None = None) -> Mapping[ConstraintData, float]:
        """Multipliers of constraints, in the sign of Pyomo's ``dual``."""
        duals = dict(zip(self._compiled.constraints, self._row_multipliers().tolist(), strict=True))
        return duals if cons_to_load is None else {constraint: duals[constraint] for constraint in cons_to_load}

    def get_reduced_costs(self, vars_to_load: Sequence[VarData] | None = None) -> Mapping[VarData, float]:
        """Multipliers of bounds: that of the lower or of the upper one, whichever is larger in size."""
        lower, upper = self._bound_multipliers()
        return _selected(self._compiled.variables, np.where(np.abs(upper) > np.abs(lower), upper, lower), vars_to_load)

    def row_multipliers(self) -> RowMultipliers:
        """Multipliers of rows and bounds, in the signs of Pyomo's suffixes."""
        variables, lower_upper = [id(variable) for variable in self._compiled.variables], self._bound_multipliers()
        duals = dict(zip(map(id, self._compiled.constraints), self._row_multipliers().tolist(), strict=True))
        return RowMultipliers(duals, *(dict(zip(variables, of.tolist(), strict=True)) for of in lower_upper))

    def load_import_suffixes(self) -> None:
        """Fill ``dual``, ``rc``, ``ipopt_zL_out`` and ``ipopt_zU_out`` where they are declared for import."""
        sources: dict[str, Callable[[], Any]] = {"dual": self.get_duals, "rc": self.get_reduced_costs}
        for name, of in zip(("ipopt_zL_out", "ipopt_zU_out"), self._bound_multipliers(), strict=True):
            sources[name] = partial(_selected, self._compiled.variables, of, None)
        for name, suffix in self._collect_and_clear_import_suffixes().items():
            if name in sources:
                suffix.update(sources[name]())

    def _row_multipliers(self) -> FloatArray:
        return -self._compiled.sign * self._outcome.g_multipliers

    def _bound_multipliers(self) -> tuple[FloatArray, FloatArray]:
        sign = self._compiled.sign
        # Adding zero turns -0.0 into 0.0, which reads better in a report.
        return sign * self._outcome.lower_multipliers + 0.0, -sign * self._outcome.upper_multipliers + 0.0


def _selected(variables: Sequence[VarData], values: FloatArray, wanted: Sequence[VarData] | None) -> ComponentMap:
    everything = ComponentMap(zip(variables, values.tolist(), strict=True))
    return everything if wanted is None else ComponentMap((variable, everything[variable]) for variable in wanted)
