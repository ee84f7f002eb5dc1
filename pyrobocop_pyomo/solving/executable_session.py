"""Continuation through the ``ipopt`` executable: one barrier problem per process, warm in primal and dual values.

A ``.nl`` file cannot change during a solve. The path that delta follows with mu inside a solve is therefore walked
from outside: one run per barrier parameter, with ``mu_init`` and ``mu_target`` at that value and all multipliers
handed over, in the sequence that Ipopt's monotone strategy takes (Waechter & Biegler 2006, eq. 7,
doi:10.1007/s10107-004-0559-y).
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from pyomo.common.collections import ComponentMap
from pyomo.common.modeling import unique_component_name
from pyomo.contrib.solver.common.results import Results, TerminationCondition
from pyomo.contrib.solver.solvers.ipopt import Ipopt
from pyomo.core.base.block import Block
from pyomo.core.base.suffix import Suffix

from pyrobocop_pyomo.complementarity import BarrierSchedule
from pyrobocop_pyomo.complementarity.relaxed_model import RelaxedModel
from pyrobocop_pyomo.errors import SolverNotFoundError
from pyrobocop_pyomo.ipopt.backends import NO_IPOPT, find_ipopt_executable, ipopt_executable_version
from pyrobocop_pyomo.ipopt.in_process import CONDITIONS
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.ipopt.linear_solvers import SAID_OF_OWN_SOLVER, refused_options, with_linear_solver
from pyrobocop_pyomo.ipopt.suffixes import FoundPoint
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.programs.asl_program import WRITER_OPTIONS, checked_writing
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.model_checks import refuse_function_calls
from pyrobocop_pyomo.programs.nonlinear_program import PrimalDualPoint, Scales

from .ipopt_options import IPOPT_MU_INIT, IPOPT_TOLERANCE, SCALED, IpoptOptions, warm_start
from .iterates import Iterate
from .session import Session
from .strategies import Settings

_SUFFIXES = {
    "dual": Suffix.IMPORT_EXPORT,
    "ipopt_zL_out": Suffix.IMPORT,
    "ipopt_zU_out": Suffix.IMPORT,
    "ipopt_zL_in": Suffix.EXPORT,
    "ipopt_zU_in": Suffix.EXPORT,
    "scaling_factor": Suffix.EXPORT,
}
# Ipopt would judge a scaled problem by these absolute tolerances in the user's units as well.
_SCALED = {
    **SCALED,
    "nlp_scaling_method": "user-scaling",
    "dual_inf_tol": 1e10,
    "constr_viol_tol": 1e10,
    "compl_inf_tol": 1e10,
    "honor_original_bounds": "yes",  # as `Scales.unscaled`
}

# The executable has no callback that could stop it.
_STATUS: dict[TerminationCondition, IpoptStatus] = {
    **{condition: status for status, condition in CONDITIONS.items() if status is not IpoptStatus.STOPPED},
    TerminationCondition.convergenceCriteriaSatisfied: IpoptStatus.SOLVED,
    TerminationCondition.provenInfeasible: IpoptStatus.INFEASIBLE,
}

# The executable tells failures apart by its last words only.
_STATUS_OF_MESSAGE = {
    "Search Direction is becoming Too Small": IpoptStatus.TINY_STEP,
    "Restoration Failed": IpoptStatus.RESTORATION_FAILED,
    "Maximum Number of Iterations": IpoptStatus.ITERATION_LIMIT,
    "Maximum wallclock time": IpoptStatus.TIME_LIMIT,
    "Maximum CPU time": IpoptStatus.TIME_LIMIT,
    "Library loading failure": IpoptStatus.INVALID_OPTION,
}


# What a run leaves, and the next one may start from.
_ARRIVED, _HANDED = ("dual", "ipopt_zL_out", "ipopt_zU_out"), ("dual", "ipopt_zL_in", "ipopt_zU_in")


class _PatientIpopt(Ipopt):
    """Pyomo's interface, which raises where ``ipopt --version`` has not answered within two seconds."""

    _version_timeout = 60


class ExecutableSession(Session):
    """See `Session`; parameters as for `InProcessSession`, without a choice of derivatives."""

    derivatives = "ASL"
    _scaled_options = _SCALED

    def __init__(self, relaxed: RelaxedModel, settings: Settings) -> None:
        path = find_ipopt_executable()
        if path is None:
            raise SolverNotFoundError(NO_IPOPT)
        self.solver = f"{ipopt_executable_version(path) or 'Ipopt'} ({path})"
        self._ipopt = _PatientIpopt(executable=path)
        model = self._model = relaxed.model
        refuse_function_calls(model)
        super().__init__(relaxed, _compiled_or_none(model), settings)
        names = {*_SUFFIXES} if self._stated is not None else {*_SUFFIXES} - {"scaling_factor"}
        # Where the user has suffixes of the same names, theirs would be filled instead of ours.
        self._deactivated = [
            suffix for suffix in model.component_objects(Suffix, active=True) if suffix.local_name in names
        ]
        for suffix in self._deactivated:
            suffix.deactivate()
        self._own = Block(concrete=True)
        model.add_component(unique_component_name(model, "warm_start"), self._own)
        for name, direction in _SUFFIXES.items():
            if name in names:
                self._own.add_component(name, Suffix(direction=direction, datatype=Suffix.FLOAT))

    def _write_factors(self, scales: Scales) -> None:
        """Let Ipopt divide by these sizes."""
        compiled, factors = self._compiled, self._own.component("scaling_factor")
        assert compiled is not None
        factors.clear()
        for components, sizes in ((compiled.variables, scales.x), (compiled.constraints, scales.g)):
            factors.update((components[k], 1.0 / float(sizes[k])) for k in np.flatnonzero(sizes > 1.0))
        if compiled.objective is not None:
            factors[compiled.objective] = 1.0 / scales.objective

    def follow(self, schedule: BarrierSchedule, options: IpoptOptions, deadline: Deadline) -> Iterator[Iterate]:
        """See `Session.follow`."""
        first = options.resolve()
        tolerance = float(first.get("tol", IPOPT_TOLERANCE))
        mu = float(first.get("mu_init", IPOPT_MU_INIT))
        start: Iterate | None = None
        while True:
            last = mu <= tolerance
            # Stop at this barrier problem, solved as loosely as Ipopt itself would before reducing mu.
            loose = {} if last else {"tol": max(tolerance, 10 * mu)}
            warm = {} if start is None else warm_start(mu)
            # The first parameter may be the user's; it is the path itself that goes on from there.
            resolved = {**options.resolve(warm, loose), "mu_init": mu, **({} if last else {"mu_target": mu})}
            delta = schedule.delta_for(mu)
            self._move_to(delta)
            start = replace(self._solve(resolved, deadline, start), label="delta = mu, from outside", delta=delta)
            yield start
            if last or not start.converged:
                return
            mu = max(tolerance / 10, min(0.2 * mu, mu**1.5))

    def _solve(self, options: Mapping[str, Any], deadline: Deadline, start: Iterate | None) -> Iterate:
        for arrived, handed in zip(_ARRIVED, _HANDED, strict=True):
            suffix = self._own.component(handed)
            entries = [] if start is None else list(start.multipliers[arrived].items())
            suffix.clear()
            suffix.update(entries)
        options, scales = self._with_scaling(options)
        if scales is not None:
            self._write_factors(scales)
        started = time.perf_counter()
        resolved, own = with_linear_solver(options)
        for stream in self._output if own else ():
            stream.write(SAID_OF_OWN_SOLVER)
        status, iterations = self._run_process(resolved, deadline)
        multipliers = {name: ComponentMap(self._own.component(name).items()) for name in _ARRIVED}
        loader = FoundPoint(
            self._model, ((), ()), {name: (tuple(of), tuple(of.values())) for name, of in multipliers.items()}
        )
        iterate = Iterate.of_run(
            "solve",
            status,
            mu=options.get("mu_target"),
            options=options,
            iterations=iterations,
            seconds=time.perf_counter() - started,
            multipliers=multipliers,
            load_suffixes=loader.load_import_suffixes,
            row_multipliers=loader.row_multipliers,
        )
        return self._with_stationarity(iterate)

    def _run_process(self, options: Mapping[str, Any], deadline: Deadline) -> tuple[IpoptStatus, int]:
        """One process: its status and iterations; its point is put on the model."""
        limit = {} if deadline.left is None else {"max_wall_time": max(deadline.left, 1e-3)}
        try:
            with checked_writing(self._model):
                results = self._ipopt.solve(
                    self._model,
                    tee=list(self._output),
                    load_solutions=False,
                    raise_exception_on_nonoptimal_result=False,
                    solver_options={**options, **limit},
                    writer_config=dict(WRITER_OPTIONS),
                )
        except KeyboardInterrupt:
            # The process is gone with its iterate; what the last run left is on the model still.
            return IpoptStatus.INTERRUPTED, 0
        status = _status_of(results)
        if status is IpoptStatus.INVALID_OPTION:
            raise refused_options(options)
        if results.solution_loader.get_number_of_solutions():
            results.solution_loader.load_solution()
        return status, int(results.extra_info.iteration_count or 0)

    def compiled(self, *, anew: bool = False) -> CompiledModel | None:
        """See `Session.compiled`."""
        return _compiled_or_none(self._model) if anew else self._compiled

    def primal_dual(self, iterate: Iterate, compiled: CompiledModel) -> PrimalDualPoint:
        """See `Session.primal_dual`."""
        sign = compiled.sign
        rows, lower, upper = (iterate.multipliers[name] for name in _ARRIVED)
        return PrimalDualPoint(
            compiled.current_point(),
            np.array([-sign * rows.get(row, 0.0) for row in compiled.constraints]),
            np.array([sign * lower.get(variable, 0.0) for variable in compiled.variables]),
            np.array([-sign * upper.get(variable, 0.0) for variable in compiled.variables]),
        )

    def close(self) -> None:
        """See `Session.close`."""
        self._model.del_component(self._own)
        for suffix in self._deactivated:
            suffix.activate()


def _compiled_or_none(model: Any) -> CompiledModel | None:
    try:
        return CompiledModel(model)
    except SolverNotFoundError:
        return None


def _status_of(results: Results) -> IpoptStatus:
    """What the executable's code and its last words say."""
    status = _STATUS.get(results.termination_condition, IpoptStatus.INTERNAL_ERROR)
    if not status.solved:
        for words, told in _STATUS_OF_MESSAGE.items():
            if words in (results.solver_log or ""):
                status = told
    return status
