"""Ipopt in this process as a Pyomo solver: ``SolverFactory("pyrobocop.ipopt")``; solvers in Pyomo's older interface."""

from __future__ import annotations

import contextlib
import datetime
import logging
from collections.abc import Collection
from typing import Any

from pyomo.common.config import ADVANCED_OPTION, ConfigValue, In
from pyomo.common.errors import InfeasibleConstraintException
from pyomo.common.timing import HierarchicalTimer, default_timer
from pyomo.contrib.solver.common.base import Availability, LegacySolverWrapper, SolverBase
from pyomo.contrib.solver.common.config import SolverConfig
from pyomo.contrib.solver.common.factory import SolverFactory
from pyomo.contrib.solver.common.results import Results, SolutionStatus, TerminationCondition
from pyomo.contrib.solver.common.solution_loader import NoSolutionSolutionLoader
from pyomo.contrib.solver.common.util import NoOptimalSolutionError, NoSolutionError
from pyomo.core.base.block import BlockData
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.PyomoModel import ModelSolution
from pyomo.core.base.suffix import Suffix
from pyomo.core.base.var import Var
from pyomo.core.staleflag import StaleFlagManager
from pyomo.opt.base.solvers import OptSolver
from pyomo.opt.results.container import ScalarData

from pyrobocop_pyomo.errors import EvaluationError, FunctionError, ModelError, SolverNotFoundError
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.programs.asl_program import asl_available
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.vectorised_program import casadi_available

from .backends import available_backends, load_ipopt_library
from .ipopt_outcome import IpoptOutcome, IpoptStatus
from .ipopt_run import run_ipopt
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
        variables = model.component_data_objects(Var, descend_into=True)
        older.problem.number_of_variables = sum(not variable.fixed for variable in variables)
        rows = model.component_data_objects(Constraint, active=True, descend_into=True)
        older.problem.number_of_constraints = len(list(rows))
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
            if all(variable.value is not None for variable in model.component_data_objects(Var, active=True)):
                # `pyomo solve` writes what the model keeps here, with the values that the model has: all, or it fails.
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


class LegacyInProcessIpopt(OlderInterface, InProcessIpopt):
    """`InProcessIpopt` in Pyomo's older interface."""

    own_options = ("derivatives",)


SolverFactory.register(
    name="pyrobocop.ipopt", legacy_name="pyrobocop.ipopt", doc="Ipopt in this process: no executable needed"
)(InProcessIpopt, LegacyInProcessIpopt)
