"""Solvers in Pyomo's older interface, that of ``pyomo solve``: sizes and messages in results, and options by name."""

from __future__ import annotations

import logging
from collections.abc import Collection
from typing import Any

from pyomo.contrib.solver.common.base import LegacySolverWrapper
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.PyomoModel import ModelSolution
from pyomo.core.base.suffix import Suffix
from pyomo.core.base.var import Var
from pyomo.opt.base.solvers import OptSolver
from pyomo.opt.results.container import ScalarData

logger = logging.getLogger(__name__)


class _Text(ScalarData):
    """An entry of the older results whose text may be made when it is written."""

    def get_value(self) -> str:
        """Plain text, as files need it."""
        return str(self.value)


class OlderInterface(LegacySolverWrapper):
    """A solver of this package in Pyomo's older interface.

    Attributes
    ----------
    own_options : collection of str
        Names of options that are the solver's own, and not Ipopt's.
    """

    own_options: Collection[str] = ()

    def _map_results(self, model: Any, results: Any) -> tuple[Any, Any]:
        older, solution = super()._map_results(model, results)
        older.problem.name = model.name
        older.problem.number_of_variables = sum(
            not variable.fixed for variable in model.component_data_objects(Var, descend_into=True)
        )
        older.problem.number_of_constraints = sum(
            1 for _ in model.component_data_objects(Constraint, active=True, descend_into=True)
        )
        older.solver.name = self.name
        for name in ("Message", "Termination message"):
            dict.__setitem__(older.solver[0], name, _Text(results.extra_info.solver_message))
        older.solver.wallclock_time = results.timing_info.wall_time
        return older, solution

    def _solution_handler(
        self, load_solutions: bool, model: Any, results: Any, legacy_results: Any, legacy_soln: Any
    ) -> Any:
        older = super()._solution_handler(load_solutions, model, results, legacy_results, legacy_soln)
        if load_solutions and hasattr(model, "solutions"):
            model.solutions.clear()
            if _can_be_written(model):
                # `pyomo solve` writes what the model keeps here, with the values that the model has.
                model.solutions.solutions.append(_solution_with_multipliers(model, legacy_soln))
        return older

    def set_options(self, options: Any) -> None:
        """Take the options of ``pyomo solve --solver-options``: its own by name, all others for Ipopt."""
        given = {name: number for name, number in _as_dict(options).items() if number is not None}
        limit = given.pop("timelimit", None)
        if limit:
            self.config.time_limit = limit
        self.config.set_value({name: given.pop(name) for name in list(given) if name in self.own_options})
        for name, number in given.items():
            self.config.solver_options[name] = number


def _can_be_written(model: Any) -> bool:
    """Whether every variable has a value: Pyomo writes all of them or fails."""
    missing = [variable.name for variable in model.component_data_objects(Var, active=True) if variable.value is None]
    if missing:
        logger.info(
            "'%s': %d variables have no value, '%s' among them: no row holds them. Pyomo writes only solutions with a "
            "value for each, so that there is none in the results. The values of the others are on the model; print "
            "them in a function pyomo_postprocess(options, instance, results) of the model file.",
            model.name,
            len(missing),
            missing[0],
        )
    return not missing


def _solution_with_multipliers(model: Any, found: Any) -> ModelSolution:
    solution = ModelSolution()
    solution.status, solution.message = found.status, found.message
    for name, kind, key in (("dual", "constraint", "Dual"), ("rc", "variable", "Rc")):
        suffix = model.component(name)
        if suffix is not None and suffix.ctype is Suffix and suffix.import_enabled():
            solution._entry[kind].update((id(part), (part, {key: number})) for part, number in suffix.items())
    return solution


def _as_dict(options: Any) -> dict[str, Any]:
    """Options as the command gives them: text such as ``"tol=1e-9 max_iter=500"``, or a mapping from a file."""
    if isinstance(options, str):
        return dict(OptSolver._options_string_to_dict(options))
    return dict(options.value() if hasattr(options, "value") else options)
