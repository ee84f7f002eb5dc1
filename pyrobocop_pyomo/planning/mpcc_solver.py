"""The procedure as a Pyomo solver: ``SolverFactory("pyrobocop.mpcc")``."""

from __future__ import annotations

import datetime
import inspect
import re
from collections import UserString
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from pyomo.common.config import ConfigValue
from pyomo.common.timing import HierarchicalTimer
from pyomo.contrib.solver.common.base import Availability, SolverBase
from pyomo.contrib.solver.common.config import SolverConfig
from pyomo.contrib.solver.common.factory import SolverFactory
from pyomo.contrib.solver.common.results import Results, SolutionStatus, TerminationCondition
from pyomo.contrib.solver.common.util import NoOptimalSolutionError
from pyomo.core.base.block import BlockData
from pyomo.core.base.suffix import Suffix

from pyrobocop_pyomo._version import __version__
from pyrobocop_pyomo.errors import KeywordError
from pyrobocop_pyomo.ipopt.backends import available_backends
from pyrobocop_pyomo.ipopt.in_process import CONDITIONS, OlderInterface
from pyrobocop_pyomo.ipopt.suffixes import FoundPoint
from pyrobocop_pyomo.modeling.keywords import check_keywords
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.solving.iterates import STOP_REASONS, Quality, StopReason
from pyrobocop_pyomo.solving.solve_result import SolveResult

from .recovery import PlanningPoint, imported_suffixes
from .solve import OTHER_WORDS, solve

# Every Pyomo solver has these, some under another name.
_OF_EVERY_SOLVER = ("model", "options", "tee", "time_limit")


# What `solve` can be told, with its default. A solver that is called by other code has nobody to show progress to.
CHOICES = {
    name: False if name == "progress" else parameter.default
    for name, parameter in inspect.signature(solve).parameters.items()
    if name not in _OF_EVERY_SOLVER
}

# Asked for even where the user declares no suffix, so that the loader can be asked for them.
_ALWAYS_IMPORTED = ("dual", "rc")

_CONDITIONS = {
    **{reason: CONDITIONS[status] for status, reason in STOP_REASONS.items()},
    StopReason.FINISHED: TerminationCondition.unknown,  # it ran to its end, and shows too little
    StopReason.FAILED: TerminationCondition.error,
}


class MpccConfig(SolverConfig):
    """Options of `Mpcc`."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        for name, default in CHOICES.items():
            self.declare(name, ConfigValue(default=default, description=f"See {name}= of pyrobocop_pyomo.solve."))

    def set_value(self, value: Any, skip_implicit: bool = False) -> Any:
        """Take options by name; those of earlier versions are refused with what to write."""
        check_keywords("pyrobocop.mpcc", {*(value or ())} & OTHER_WORDS.keys(), self, KeywordError, OTHER_WORDS)
        return super().set_value(value, skip_implicit)


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
        before = PlanningPoint(model)
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
                results.solution_loader = _found_point(model)
        finally:
            timer.stop("solve")
        _report(results, answer)
        results.timing_info.timer = timer
        results.timing_info.wall_time = answer.seconds
        if config.raise_exception_on_nonoptimal_result and not answer.solved:
            before.restore()
            message = f"{NoOptimalSolutionError.default_message} {results.extra_info.solver_message}"
            error = NoOptimalSolutionError(message)
            error.results = results
            raise error
        if config.load_solutions:
            results.solution_loader.load_import_suffixes()
        else:
            before.restore()
        return results


class LegacyMpcc(OlderInterface, Mpcc):
    """`Mpcc` in Pyomo's older interface."""

    own_options = tuple(CHOICES)


SolverFactory.register(
    name="pyrobocop.mpcc",
    legacy_name="pyrobocop.mpcc",
    doc="Mathematical programs with complementarity constraints: continuation, polish and certificate",
)(Mpcc, LegacyMpcc)


def _report(results: Results, answer: SolveResult) -> None:
    results.solution_status = SolutionStatus[answer.quality.name.lower()]
    results.termination_condition = (
        TerminationCondition.convergenceCriteriaSatisfied if answer.solved else _CONDITIONS[answer.stop_reason]
    )
    if answer.quality is not Quality.INFEASIBLE:
        results.incumbent_objective = answer.objective
    results.extra_info.add("result", ConfigValue(answer))
    results.extra_info.iteration_count = answer.iterations
    results.extra_info.solver_message = _Message(answer)


class _Message(UserString):
    """What is said of an answer; made when it is read, since the error of the mesh takes as long as a short solve."""

    def __init__(self, answer: SolveResult) -> None:
        self._answer = answer

    def __reduce__(self) -> Any:
        return str, (self.data,)

    @property
    def data(self) -> str:  # type: ignore[override]
        """The text."""
        answer = self._answer
        motion = None if answer.safety is None else f"The motion: {answer.safety.word}"
        said = (answer.stop_reason.value, answer.quality.value, motion, answer.errors_of_answer.in_short())
        return " ".join(filter(None, said))


def _found_point(model: BlockData) -> FoundPoint:
    """What a model holds now, to be loaded when it is requested."""
    values = VariableValues.of_free(model)
    # Of several with one name, that nearest to the root.
    found = reversed(imported_suffixes(model))
    suffixes = {suffix.local_name: (list(suffix.keys()), list(suffix.values())) for suffix in found}
    return FoundPoint(model, (values.variables, values.taken), suffixes)


@contextmanager
def multipliers_imported(model: BlockData) -> Iterator[None]:
    """Declare the usual import suffixes where nothing has their names; afterwards they are gone."""
    present = {suffix.local_name for suffix in imported_suffixes(model)}
    added = []
    for name in _ALWAYS_IMPORTED:
        if name not in present and not hasattr(model, name):
            model.add_component(name, Suffix(direction=Suffix.IMPORT))
            added.append(name)
    try:
        yield
    finally:
        for name in added:
            model.del_component(name)
