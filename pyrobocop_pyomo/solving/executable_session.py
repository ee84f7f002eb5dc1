"""Continuation through the ``ipopt`` executable: one barrier problem per process, warm in primal and dual values.

A ``.nl`` file cannot change during a solve. The path that delta follows with mu inside a solve is therefore walked
from outside: one run per barrier parameter, with ``mu_init`` and ``mu_target`` at that value and all multipliers
handed over, in the sequence that Ipopt's monotone strategy takes (Waechter & Biegler 2006, eq. 7,
doi:10.1007/s10107-004-0559-y).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, TextIO

import numpy as np
from pyomo.common.modeling import unique_component_name
from pyomo.contrib.solver.common.results import TerminationCondition
from pyomo.contrib.solver.solvers.ipopt import Ipopt
from pyomo.core.base.block import Block
from pyomo.core.base.suffix import Suffix

from pyrobocop_pyomo.complementarity import BarrierSchedule
from pyrobocop_pyomo.errors import SolverNotFoundError
from pyrobocop_pyomo.ipopt.backends import NO_IPOPT
from pyrobocop_pyomo.ipopt.ipopt_executable import find_ipopt_executable, ipopt_executable_version
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.programs.compiled_model import WRITER_OPTIONS, CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray

from .relaxed_model import RelaxedModel
from .session import DEFAULT_MU, WARM_START_OPTIONS, Run

_SUFFIXES = {
    "dual": Suffix.IMPORT_EXPORT,
    "ipopt_zL_out": Suffix.IMPORT,
    "ipopt_zU_out": Suffix.IMPORT,
    "ipopt_zL_in": Suffix.EXPORT,
    "ipopt_zU_in": Suffix.EXPORT,
}

_STATUS = {
    TerminationCondition.convergenceCriteriaSatisfied: IpoptStatus.SOLVED,
    TerminationCondition.iterationLimit: IpoptStatus.ITERATION_LIMIT,
    TerminationCondition.maxTimeLimit: IpoptStatus.TIME_LIMIT,
    TerminationCondition.locallyInfeasible: IpoptStatus.INFEASIBLE,
    TerminationCondition.provenInfeasible: IpoptStatus.INFEASIBLE,
    TerminationCondition.unbounded: IpoptStatus.DIVERGING,
    TerminationCondition.interrupted: IpoptStatus.INTERRUPTED,
    TerminationCondition.minStepLength: IpoptStatus.TINY_STEP,
}

# The executable tells failures apart by its last words only.
_STATUS_OF_MESSAGE = {
    "Search Direction is becoming Too Small": IpoptStatus.TINY_STEP,
    "Restoration Failed": IpoptStatus.RESTORATION_FAILED,
    "Maximum Number of Iterations": IpoptStatus.ITERATION_LIMIT,
    "Maximum wallclock time": IpoptStatus.TIME_LIMIT,
    "Maximum CPU time": IpoptStatus.TIME_LIMIT,
}


class ExecutableSession:
    """See `Session`; parameters as for `InProcessSession`, without a choice of derivatives."""

    derivatives = "ASL"

    def __init__(self, relaxed: RelaxedModel, options: Mapping[str, Any], output: Sequence[TextIO]) -> None:
        path = find_ipopt_executable()
        if path is None:
            raise SolverNotFoundError(NO_IPOPT)
        self.solver = f"{ipopt_executable_version(path) or 'Ipopt'} ({path})"
        self._ipopt = Ipopt(executable=path)
        model = self._model = relaxed.model
        self._relaxed = relaxed
        self._options = dict(options)
        self._output = list(output)
        # The user's suffixes of the same names sleep meanwhile: otherwise theirs would be filled instead of ours.
        self._sleeping = [
            suffix for suffix in model.component_objects(Suffix, active=True) if suffix.local_name in _SUFFIXES
        ]
        for suffix in self._sleeping:
            suffix.deactivate()
        self._own = Block(concrete=True)
        model.add_component(unique_component_name(model, "warm_start"), self._own)
        for name, direction in _SUFFIXES.items():
            self._own.add_component(name, Suffix(direction=direction, datatype=Suffix.FLOAT))

    def run(
        self,
        delta: float | None,
        *,
        warm: bool = False,
        time_limit: float | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> Run:
        """See `Session.run`."""
        options = {**self._options, **(options or {})}
        if warm:
            options = {**WARM_START_OPTIONS, "mu_init": min(DEFAULT_MU, delta or 1e-6), **options}
        return self._run("fixed delta" if delta is not None else "solve", delta, options, warm, time_limit)

    def follow(
        self, schedule: BarrierSchedule, *, time_limit: float | None = None, options: Mapping[str, Any] | None = None
    ) -> Iterator[Run]:
        """See `Session.follow`."""
        started = time.perf_counter()
        wanted = {**self._options, **(options or {})}
        tolerance = float(wanted.get("tol", 1e-8))
        mu = float(wanted.get("mu_init", DEFAULT_MU))
        warm = False
        while True:
            last = mu <= tolerance
            now = {**wanted, "mu_init": mu}
            if warm:
                now = {**WARM_START_OPTIONS, **now}
            if not last:
                # Stop at this barrier problem, solved as loosely as Ipopt itself would before reducing mu.
                now |= {"mu_target": mu, "tol": max(tolerance, 10 * mu)}
            left = None if time_limit is None else time_limit - (time.perf_counter() - started)
            run = self._run("delta = mu, from outside", schedule.delta_for(mu), now, warm, left)
            yield run
            if last or not (run.status.solved or run.status is IpoptStatus.TINY_STEP):
                return
            mu, warm = max(tolerance / 10, min(0.2 * mu, mu**1.5)), True

    def _run(
        self, label: str, delta: float | None, options: Mapping[str, Any], warm: bool, time_limit: float | None
    ) -> Run:
        if delta is not None:
            self._relaxed.go_on_to(delta, self._own.dual if warm else None)
        for name in ("ipopt_zL", "ipopt_zU"):
            arriving = self._own.component(f"{name}_in")
            arriving.clear()
            if warm:
                arriving.update(self._own.component(f"{name}_out").items())
        if not warm:
            self._own.dual.clear()
        if time_limit is not None:
            options = {**options, "max_wall_time": max(time_limit, 1e-3)}
        started = time.perf_counter()
        try:
            results = self._ipopt.solve(
                self._model,
                tee=self._output,
                load_solutions=False,
                raise_exception_on_nonoptimal_result=False,
                solver_options=dict(options),
                writer_config=dict(WRITER_OPTIONS),
            )
        except KeyboardInterrupt:
            # The process is gone with its iterate; what the last run left is on the model still.
            return Run(label, delta, None, IpoptStatus.INTERRUPTED, 0, time.perf_counter() - started)
        if results.solution_loader.get_number_of_solutions():
            results.solution_loader.load_solution()
        status = _STATUS.get(results.termination_condition, IpoptStatus.INTERNAL_ERROR)
        for words, told in _STATUS_OF_MESSAGE.items():
            if not status.solved and words in (results.solver_log or ""):
                status = told
        iterations = int(results.extra_info.iteration_count or 0)
        mu = options.get("mu_target") or None
        return Run(label, delta, mu, status, iterations, time.perf_counter() - started)

    def written(self, *, anew: bool = False) -> CompiledModel | None:
        """See `Session.written`."""
        try:
            return CompiledModel(self._model)
        except SolverNotFoundError:
            return None

    def multipliers(self, written: CompiledModel) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See `Session.multipliers`."""
        sign, own = written.sign, self._own
        rows = np.array([-sign * own.dual.get(row, 0.0) for row in written.constraints])
        lower = np.array([sign * own.ipopt_zL_out.get(variable, 0.0) for variable in written.variables])
        upper = np.array([-sign * own.ipopt_zU_out.get(variable, 0.0) for variable in written.variables])
        return rows, lower, upper

    def stationarity(self) -> float | None:
        """See `Session.stationarity`."""
        return None

    def rewinder(self) -> Callable[[], None]:
        """See `Session.rewinder`."""
        suffixes = [self._own.component(name) for name in ("dual", "ipopt_zL_out", "ipopt_zU_out")]
        kept = [(suffix, list(suffix.items())) for suffix in suffixes]

        def rewind() -> None:
            for suffix, items in kept:
                suffix.clear()
                suffix.update(items)

        return rewind

    def suffix_loader(self) -> Callable[[], None]:
        """See `Session.suffix_loader`."""
        found = [
            (theirs, list(self._own.component(theirs.local_name).items()))
            for theirs in self._sleeping
            if theirs.import_enabled()
        ]

        def load() -> None:
            for theirs, items in found:
                theirs.clear()
                theirs.update(items)

        return load

    def close(self) -> None:
        """See `Session.close`."""
        self._model.del_component(self._own)
        for suffix in self._sleeping:
            suffix.activate()
