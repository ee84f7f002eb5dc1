"""The procedure as a Pyomo solver: ``SolverFactory("pyrobocop.mpcc")``."""

from __future__ import annotations

import datetime
import inspect
import re
from typing import Any

from pyomo.common.config import ConfigValue
from pyomo.common.timing import HierarchicalTimer
from pyomo.contrib.solver.common.base import Availability, SolverBase
from pyomo.contrib.solver.common.config import SolverConfig
from pyomo.contrib.solver.common.results import Results, SolutionStatus, TerminationCondition
from pyomo.contrib.solver.common.util import NoOptimalSolutionError
from pyomo.core.base.block import BlockData

from pyrobocop_pyomo._version import __version__
from pyrobocop_pyomo.ipopt.backends import available_backends
from pyrobocop_pyomo.planning.solve import solve
from pyrobocop_pyomo.solving.iterates import Quality, StopReason
from pyrobocop_pyomo.solving.solve_result import SolveResult

from .found_point import FoundPoint, PointOnModel, multipliers_imported

# Every Pyomo solver has these, some under another name.
_OF_EVERY_SOLVER = ("model", "options", "tee", "time_limit")


def _choices() -> dict[str, tuple[Any, str]]:
    """Default and meaning of what `solve` can be told, from its signature and the section "Parameters" of its text."""
    parameters = inspect.signature(solve).parameters
    text = inspect.cleandoc(solve.__doc__ or "").partition("Parameters\n")[2].partition("Returns\n")[0]
    meanings: dict[str, list[str]] = {}
    names: list[str] = []
    for line in text.splitlines():
        if line.startswith(" "):
            for name in names:
                meanings[name].append(line.strip())
        elif " : " in line:
            names = line.partition(" : ")[0].split(", ")
            meanings.update((name, []) for name in names)
    found = {
        name: (parameter.default, " ".join(meanings.get(name, ())))
        for name, parameter in parameters.items()
        if name not in _OF_EVERY_SOLVER
    }
    # A solver that is called by other code has nobody to show progress to.
    return {**found, "progress": (False, found["progress"][1])}


CHOICES = _choices()

_CONDITIONS = {
    StopReason.FINISHED: TerminationCondition.unknown,  # it ran to its end, and shows too little
    StopReason.ITERATION_LIMIT: TerminationCondition.iterationLimit,
    StopReason.TIME_LIMIT: TerminationCondition.maxTimeLimit,
    StopReason.INTERRUPTED: TerminationCondition.interrupted,
    StopReason.INFEASIBLE: TerminationCondition.locallyInfeasible,
    StopReason.FAILED: TerminationCondition.error,
}
_STATUSES = {
    Quality.OPTIMAL: SolutionStatus.optimal,
    Quality.FEASIBLE: SolutionStatus.feasible,
    Quality.INFEASIBLE: SolutionStatus.infeasible,
}


class MpccConfig(SolverConfig):
    """Options of `Mpcc`."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        for name, (default, meaning) in CHOICES.items():
            self.declare(name, ConfigValue(default=default, description=meaning))


class Mpcc(SolverBase):
    """Solves models with complementarity pairs, as `pyrobocop_pyomo.solve` does, in the form of a Pyomo solver.

    ``solver_options`` (``options`` of Pyomo's older interface) go to Ipopt; what `pyrobocop_pyomo.solve` can be told
    goes to the call, or to the factory. The full answer is ``results.extra_info.result``, a `SolveResult`.
    """

    CONFIG = MpccConfig()

    def available(self) -> Availability:
        """Whether there is an Ipopt."""
        return Availability.FullLicense if available_backends() else Availability.NotFound

    def version(self) -> tuple[int, ...]:
        """Version of this package; of a release candidate, that of the release."""
        return tuple(map(int, re.findall(r"\d+", __version__)[:3]))

    def solve(self, model: BlockData, **kwds: Any) -> Results:
        """Solve a Pyomo model with complementarity pairs.

        Parameters
        ----------
        model : Block
        **kwds
            Options of this call: those of every Pyomo solver (``tee``, ``load_solutions``, ``time_limit``,
            ``raise_exception_on_nonoptimal_result``, ``solver_options``), and those of `pyrobocop_pyomo.solve`.

        Returns
        -------
        Results
            ``extra_info.result`` is the `SolveResult`; ``extra_info.iteration_count`` counts Ipopt's iterations.

        Raises
        ------
        NoOptimalSolutionError
            When the point is not optimal and an exception was asked for; the results are its attribute ``results``,
            and the model is as it was.
        ModelError
            When the model makes no sense, for instance a pair that bounds and fixed variables rule out.
        SolverNotFoundError
            When there is no Ipopt; the message lists the remedies.
        """
        config = self.config(value=kwds, preserve_implicit=True)
        timer = config.timer = config.timer or HierarchicalTimer()
        results = Results()
        results.timing_info.start_timestamp = datetime.datetime.now(datetime.timezone.utc)
        results.solver_name, results.solver_version, results.solver_config = self.name, self.version(), config
        before = PointOnModel(model)
        timer.start("solve")
        try:
            with multipliers_imported(model):
                answer = solve(
                    model,
                    options=dict(config.solver_options.value()),
                    tee=config.tee,
                    time_limit=config.time_limit,
                    **{name: config[name] for name in CHOICES},
                )
                results.solution_loader = FoundPoint(model)
        finally:
            timer.stop("solve")
        _report(results, answer)
        results.timing_info.timer = timer
        results.timing_info.wall_time = answer.seconds
        if config.raise_exception_on_nonoptimal_result and not answer.solved:
            before.put_back()
            message = f"{NoOptimalSolutionError.default_message} {results.extra_info.solver_message}"
            error = NoOptimalSolutionError(message)
            error.results = results
            raise error
        if config.load_solutions:
            results.solution_loader.load_import_suffixes()
        else:
            before.put_back()
        return results


def _report(results: Results, answer: SolveResult) -> None:
    results.solution_status = _STATUSES[answer.quality]
    results.termination_condition = (
        TerminationCondition.convergenceCriteriaSatisfied if answer.solved else _CONDITIONS[answer.stop_reason]
    )
    if answer.quality is not Quality.INFEASIBLE:
        results.incumbent_objective = answer.objective
    results.extra_info.add("result", ConfigValue(answer))
    results.extra_info.iteration_count = answer.iterations
    results.extra_info.solver_message = f"{answer.stop_reason.value} {answer.quality.value}"
