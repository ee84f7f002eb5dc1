"""The procedure as a Pyomo solver: ``SolverFactory("pyrobocop.mpcc")``."""

from __future__ import annotations

import datetime
from typing import Any

from pyomo.common.config import ConfigValue
from pyomo.common.timing import HierarchicalTimer
from pyomo.contrib.solver.common.base import Availability, SolverBase
from pyomo.contrib.solver.common.config import SolverConfig
from pyomo.contrib.solver.common.factory import SolverFactory
from pyomo.contrib.solver.common.results import Results, SolutionStatus, TerminationCondition
from pyomo.contrib.solver.common.util import NoOptimalSolutionError
from pyomo.core.base.block import BlockData

from pyrobocop_pyomo._version import __version__
from pyrobocop_pyomo.ipopt.backends import available_backends
from pyrobocop_pyomo.planning.solve import solve
from pyrobocop_pyomo.solving.solve_result import Quality, SolveResult, StopReason

from .found_point import FoundPoint, PointOnModel, multipliers_imported

CHOICES = {
    "relaxation": ("scholtes", "How a product is bounded: a word or an object."),
    "grouping": ("pair", "Which products share a bound: a word or an object."),
    "schedule": (None, "How delta shrinks, in a single strategy instead of the ladder."),
    "strategies": (None, "Strategies to climb: words or Strategy objects; by default the whole ladder."),
    "polish": (True, "Make the pairs exact, follow descending branches and certify."),
    "backend": (None, "Which Ipopt: 'in process', 'asl', 'casadi', 'vectorised', 'executable' or a Backend."),
    "feasibility_tolerance": (1e-6, "Largest violation of a constraint or bound in an acceptable point."),
    "complementarity_tolerance": (1e-7, "Largest product of the two sides in an acceptable point."),
    "progress": (False, "Show a line per step; None shows it on a terminal."),
}

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

    def __init__(
        self,
        description: str | None = None,
        doc: str | None = None,
        implicit: bool = False,
        implicit_domain: Any = None,
        visibility: int = 0,
    ) -> None:
        super().__init__(description, doc, implicit, implicit_domain, visibility)
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
        """Version of this package."""
        return tuple(int(part) for part in __version__.split(".")[:3])

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


SolverFactory.register(
    name="pyrobocop.mpcc",
    legacy_name="pyrobocop.mpcc",
    doc="Mathematical programs with complementarity constraints: continuation, polish and certificate",
)(Mpcc)
