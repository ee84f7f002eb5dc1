"""Ipopt in this process as a Pyomo solver: ``SolverFactory("pyrobocop.ipopt")``."""

from __future__ import annotations

import contextlib
import datetime
import logging
from typing import Any

from pyomo.common.config import ADVANCED_OPTION, ConfigValue, In
from pyomo.common.errors import InfeasibleConstraintException
from pyomo.common.timing import HierarchicalTimer, default_timer
from pyomo.contrib.solver.common.base import Availability, SolverBase
from pyomo.contrib.solver.common.config import SolverConfig
from pyomo.contrib.solver.common.factory import SolverFactory
from pyomo.contrib.solver.common.results import Results, SolutionStatus, TerminationCondition
from pyomo.contrib.solver.common.solution_loader import NoSolutionSolutionLoader
from pyomo.contrib.solver.common.util import NoOptimalSolutionError, NoSolutionError
from pyomo.core.base.block import BlockData
from pyomo.core.staleflag import StaleFlagManager

from pyrobocop_pyomo.errors import EvaluationError, FunctionError, ModelError, SolverNotFoundError
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.rare_collections import rare_collections
from pyrobocop_pyomo.programs.asl_program import asl_available
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.vectorised_program import casadi_available

from .backends import available_backends
from .ipopt_library import load_ipopt_library
from .ipopt_outcome import IpoptOutcome, IpoptStatus
from .ipopt_run import run_ipopt
from .older_interface import OlderInterface
from .suffixes import InProcessSolutionLoader, scaling_factors, starting_point

logger = logging.getLogger(__name__)

# As Pyomo reads the executable's codes; only what it calls "limit" or "failure" is told apart further here.
CONDITIONS = {
    IpoptStatus.INFEASIBLE: TerminationCondition.locallyInfeasible,
    IpoptStatus.TINY_STEP: TerminationCondition.minStepLength,
    IpoptStatus.DIVERGING: TerminationCondition.unbounded,
    IpoptStatus.INTERRUPTED: TerminationCondition.interrupted,
    IpoptStatus.STOPPED: TerminationCondition.interrupted,
    IpoptStatus.ITERATION_LIMIT: TerminationCondition.iterationLimit,
    IpoptStatus.TIME_LIMIT: TerminationCondition.maxTimeLimit,
}


class InProcessIpoptConfig(SolverConfig):
    """Options of `InProcessIpopt`."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self.derivatives: str | None = self.declare(
            "derivatives",
            ConfigValue(
                default=None,
                domain=In([None, "asl", "casadi", "vectorised"]),
                description="Where derivatives come from: 'vectorised', which is CasADi ('casadi' says the same), or "
                "'asl'. By default CasADi where it is installed and knows all functions of the model, else ASL.",
            ),
        )
        self.on_iteration = self.declare(
            "on_iteration",
            ConfigValue(
                default=None, description="Called with the record of each iteration; stops Ipopt by returning False."
            ),
        )


class InProcessIpopt(SolverBase):
    """Ipopt's shared library in this process, with derivatives from ASL or CasADi.

    It needs no executable. The last point is in ``results.solution_loader`` whatever stopped Ipopt: a limit,
    Ctrl-C, a failure; where an exception is raised instead, it carries the results as its attribute ``results``.
    """

    CONFIG = InProcessIpoptConfig()

    def available(self) -> Availability:
        """Whether there is an Ipopt library and something to take derivatives with."""
        wanted = self.config.derivatives
        usable = {backend.derivatives for backend in available_backends()} - {None}
        is_there = bool(usable) if wanted is None else {"casadi": "vectorised"}.get(wanted, wanted) in usable
        return Availability.FullLicense if is_there else Availability.NotFound

    def version(self) -> tuple[int, int, int] | None:
        """Version of the Ipopt library; None when there is none or it cannot tell."""
        try:
            return load_ipopt_library().version
        except SolverNotFoundError:
            return None

    @rare_collections()
    def solve(self, model: BlockData, **kwds: Any) -> Results:
        """Solve a Pyomo model.

        Parameters
        ----------
        model : Block
            The model: continuous, with at most one active objective.
        **kwds
            Options of this call: ``tee``, ``load_solutions``, ``raise_exception_on_nonoptimal_result``,
            ``time_limit`` (seconds, elapsed), ``solver_options`` (Ipopt's), ``derivatives``, ``on_iteration``.

        Returns
        -------
        Results
            ``extra_info`` holds ``iteration_count``, ``iteration_log`` (records with mu), ``derivatives``,
            ``ipopt_library``, ``ipopt_status`` and ``solver_message``.
        """
        started = default_timer()
        config = self.config(value=kwds, preserve_implicit=True)
        timer = config.timer = config.timer or HierarchicalTimer()
        results = Results()
        results.timing_info.start_timestamp = datetime.datetime.now(datetime.timezone.utc)
        results.solver_name = self.name
        results.solver_config = config
        library = load_ipopt_library()
        results.solver_version = library.version
        results.extra_info.ipopt_library = library.path
        StaleFlagManager.mark_all_as_stale()
        timer.start("write_and_build")
        try:
            compiled = _compiled(model, config.derivatives)
        except InfeasibleConstraintException as error:
            compiled = None
            _report_proven_infeasible(results, model, str(error))
        finally:
            timer.stop("write_and_build")
        if compiled is not None:
            logger.info("'%s': %s, derivatives by %s", model.name, library, compiled.nlp.derivatives)
            timer.start("ipopt")
            try:
                outcome = _run(compiled, config)
            finally:
                timer.stop("ipopt")
            _report(results, compiled, outcome)
        _raise_or_load(results, config)
        results.timing_info.timer = timer
        results.timing_info.wall_time = default_timer() - started
        return results


def _compiled(model: BlockData, derivatives: str | None) -> CompiledModel:
    """The program by what the caller chose; else by the first source of derivatives that takes the model."""
    if derivatives is None and casadi_available() and asl_available():
        try:
            return CompiledModel(model, "vectorised")
        except (ModelError, EvaluationError) as error:
            logger.info("'%s': not vectorised: %s", model.name, error)
            with contextlib.suppress(FunctionError):  # ASL calls no functions in Python
                return CompiledModel(model, "asl")
            raise
    return CompiledModel(model, derivatives)


def _run(compiled: CompiledModel, config: InProcessIpoptConfig) -> IpoptOutcome:
    options = dict(config.solver_options.value())
    if config.threads and config.threads != 1:
        logger.warning("threads=%d has no effect: Ipopt's linear solvers decide by themselves.", config.threads)
    return run_ipopt(
        compiled.nlp,
        options,
        starting_point(compiled),
        deadline=Deadline.after(config.time_limit),
        scaling=scaling_factors(compiled) if options.get("nlp_scaling_method") == "user-scaling" else None,
        on_iteration=config.on_iteration,
        output=config.tee,
    )


def _report(results: Results, compiled: CompiledModel, outcome: IpoptOutcome) -> None:
    if outcome.status.solved:
        results.termination_condition = TerminationCondition.convergenceCriteriaSatisfied
        results.solution_status = SolutionStatus.optimal
    else:
        results.termination_condition = CONDITIONS.get(outcome.status, TerminationCondition.error)
        is_infeasible = outcome.status is IpoptStatus.INFEASIBLE
        results.solution_status = SolutionStatus.infeasible if is_infeasible else SolutionStatus.unknown
    results.solution_loader = InProcessSolutionLoader(compiled, outcome)
    results.solver_log = outcome.log
    results.extra_info.derivatives = compiled.nlp.derivatives
    if outcome.status.solved and compiled.objective is not None:
        results.incumbent_objective = compiled.sign * outcome.objective
    results.extra_info.solver_message = outcome.status.value
    results.extra_info.ipopt_status = outcome.status
    results.extra_info.iteration_count = outcome.iterations
    results.extra_info.add("iteration_log", ConfigValue(outcome.records, visibility=ADVANCED_OPTION))
    results.timing_info.ipopt = outcome.seconds
    results.timing_info.evaluations = outcome.evaluation_seconds


def _report_proven_infeasible(results: Results, model: BlockData, reason: str) -> None:
    """A row without free variables contradicts itself: the writer found it before Ipopt was asked."""
    results.termination_condition = TerminationCondition.provenInfeasible
    results.solution_status = SolutionStatus.noSolution
    results.solution_loader = NoSolutionSolutionLoader(model, reason)
    results.extra_info.solver_message = reason
    results.extra_info.iteration_count = 0


def _raise_or_load(results: Results, config: InProcessIpoptConfig) -> None:
    """As Pyomo's ipopt_v2 does it: an exception leaves the model as it was. The results go with the exception."""
    if config.raise_exception_on_nonoptimal_result and results.solution_status is not SolutionStatus.optimal:
        error = NoOptimalSolutionError(f"{NoOptimalSolutionError.default_message} {results.extra_info.solver_message}")
        error.results = results
        raise error
    if config.load_solutions:
        if results.solution_status is SolutionStatus.noSolution:
            raise NoSolutionError(results.extra_info.solver_message)
        results.solution_loader.load_solution()


class LegacyInProcessIpopt(OlderInterface, InProcessIpopt):
    """`InProcessIpopt` in Pyomo's older interface."""

    own_options = ("derivatives",)


SolverFactory.register(
    name="pyrobocop.ipopt", legacy_name="pyrobocop.ipopt", doc="Ipopt in this process: no executable needed"
)(InProcessIpopt, LegacyInProcessIpopt)
