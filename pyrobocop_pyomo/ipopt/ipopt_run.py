"""One run of Ipopt in this process, with everything that can happen during it."""

from __future__ import annotations

import contextlib
import ctypes
import io
import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TextIO

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.modeling.deadline import NO_DEADLINE, Deadline
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram, PrimalDualPoint
from pyrobocop_pyomo.programs.scaled_program import ScaledProgram
from pyrobocop_pyomo.programs.scales import Scales

from .c_output import c_output_sent_to, flush_c_streams
from .ipopt_callbacks import KeptProblem, OnIteration, first_ctrl_c
from .ipopt_library import IpoptLibrary, load_ipopt_library
from .ipopt_options import set_options
from .ipopt_outcome import IpoptOutcome, IpoptStatus, IterationRecord
from .linear_solvers import FALL_BACK, IN_DOUBT, OWN_SOLVER, SAID_OF_OWN_SOLVER, refused_options, with_linear_solver

logger = logging.getLogger(__name__)


class ProblemScaling(NamedTuple):
    """Factors for the objective, the variables and the rows; None stands for ones."""

    objective: float = 1.0
    x: FloatArray | None = None
    g: FloatArray | None = None


def run_ipopt(
    nlp: NonlinearProgram,
    options: Mapping[str, Any],
    start: PrimalDualPoint | None = None,
    *,
    deadline: Deadline = NO_DEADLINE,
    scaling: ProblemScaling | None = None,
    on_iteration: OnIteration | None = None,
    output: Sequence[TextIO] = (),
    head: str = "",
    kept: KeptProblem | None = None,
) -> IpoptOutcome:
    """Solve a nonlinear program with Ipopt, in this process.

    Parameters
    ----------
    nlp : NonlinearProgram
        The problem.
    options : mapping of str to str, int, float or bool
        Ipopt's options. Multipliers are used when ``warm_start_init_point`` is ``"yes"`` among them. With
        ``linear_solver="ldl"``, and by default where it suits the program, Ipopt uses the linear solver of this
        package; where such a run fails, MUMPS has a try from the same start.
    start : PrimalDualPoint, optional
        First point and multipliers, by default ``nlp.x_start`` and those of `PrimalDualPoint.complete`.
    deadline : Deadline
        Ipopt stops after the first iteration that ends later.
    scaling : ProblemScaling, optional
        Factors that Ipopt uses when ``nlp_scaling_method`` is ``"user-scaling"`` among the options.
    on_iteration : callable, optional
        Called with the `IterationRecord` of each iteration; stops Ipopt by returning False.
    output : sequence of text streams
        Where Ipopt's own log goes; it is silent when there is none.
    head : str
        What stands above the log.
    kept : KeptProblem, optional
        Of earlier runs of the same program, for this run and further ones.

    Returns
    -------
    IpoptOutcome
        Also after a limit, an interruption or a failure, with the last point.

    Raises
    ------
    SolverNotFoundError
        When there is no Ipopt library, or no linear solver of this package where it is requested.
    ModelError
        For an option that Ipopt does not know, a value that it refuses, or a linear solver whose library is missing.
    Exception
        What a callback raised, after Ipopt has returned. An `EvaluationError` is none of them: Ipopt then tries a
        shorter step.
    """
    how: dict[str, Any] = {"scaling": scaling, "on_iteration": on_iteration, "output": output}
    resolved, own = with_linear_solver(options, nlp)
    said = SAID_OF_OWN_SOLVER if own else ""
    outcome = _run_once(nlp, resolved, start, kept, deadline=deadline, head=head + said, **how)
    if not own:
        return outcome
    if outcome.status not in IN_DOUBT:
        return replace(outcome, linear_solver=OWN_SOLVER)
    logger.info("with the linear solver of this package: %s MUMPS has a try.", outcome.status.value)
    again = _run_once(nlp, {**options, **FALL_BACK}, start, None, deadline=deadline, head=head, **how)
    return replace(
        again,
        seconds=outcome.seconds + again.seconds,
        cpu_seconds=outcome.cpu_seconds + again.cpu_seconds,
        evaluation_seconds=outcome.evaluation_seconds + again.evaluation_seconds,
        log=outcome.log + again.log,
        fell_back=True,
    )


def run_scaled(
    nlp: NonlinearProgram,
    scales: Scales,
    options: Mapping[str, Any],
    start: PrimalDualPoint,
    *,
    on_iteration: OnIteration | None = None,
    **how: Any,
) -> IpoptOutcome:
    """As `run_ipopt`, whose other arguments are handed on; Ipopt's options and log are about the scaled program."""

    def unscaled(record: IterationRecord) -> IterationRecord:
        return record._replace(objective=record.objective * scales.objective)

    def told(record: IterationRecord) -> bool | None:
        return None if on_iteration is None else on_iteration(unscaled(record))

    head = (
        f"The log below is about the scaled program: the objective divided by {scales.objective:.3g}, variables and "
        "rows by their typical sizes.\n"
    )
    scaled = ScaledProgram(nlp, scales)
    outcome = run_ipopt(scaled, options, scales.scaled(start), on_iteration=on_iteration and told, head=head, **how)
    return replace(
        outcome,
        objective=outcome.objective * scales.objective,
        g=outcome.g * scales.g,
        records=[unscaled(record) for record in outcome.records],
        **vars(scales.unscaled(outcome.point, nlp)),
    )


def _run_once(
    nlp: NonlinearProgram,
    options: Mapping[str, Any],
    start: PrimalDualPoint | None,
    kept: KeptProblem | None,
    *,
    deadline: Deadline,
    scaling: ProblemScaling | None,
    on_iteration: OnIteration | None,
    output: Sequence[TextIO],
    head: str,
) -> IpoptOutcome:
    library = (None if kept is None else kept.library) or load_ipopt_library()
    start = PrimalDualPoint(nlp.x_start) if start is None else start
    multipliers = start.complete(nlp)
    point, row_multipliers = _vector(start.x, nlp.n, "x"), _vector(multipliers[0], nlp.m, "g_multipliers")
    lower, upper = (
        _vector(values, nlp.n, f"{name}_multipliers")
        for name, values in zip(("lower", "upper"), multipliers[1:], strict=True)
    )
    g, objective = np.full(nlp.m, np.nan), ctypes.c_double(np.nan)
    log = io.StringIO()
    settings = {**options, **_time_limit(options, deadline)}
    started, cpu_started = time.perf_counter(), time.process_time()
    with contextlib.ExitStack() as stack:
        if output:
            for stream in (log, *output):
                stream.write(head)
                stream.flush()
            stack.enter_context(c_output_sent_to([log, *output]))
        if kept is None or scaling is not None or output:
            kept = KeptProblem()
            stack.callback(kept.close)
        problem, callbacks = stack.enter_context(kept.opened(library, nlp, frozenset(settings), on_iteration))
        if output:
            callbacks.after_record = flush_c_streams
        if scaling is not None:
            _set_scaling(library, problem, nlp, scaling)
        set_options(library, problem, settings, silent=not output)
        stack.enter_context(first_ctrl_c(callbacks.interrupt))
        code = library.functions.IpoptSolve(
            problem, point.ctypes.data, g.ctypes.data, ctypes.addressof(objective),
            row_multipliers.ctypes.data, lower.ctypes.data, upper.ctypes.data, callbacks.data,
        )  # fmt: skip
    if callbacks.failure is not None:
        raise callbacks.failure
    status = IpoptStatus.of_code(code)
    if status is IpoptStatus.INVALID_OPTION:
        raise refused_options(options)
    if callbacks.interrupted:
        # Also when Ipopt ended by itself at that moment: whoever pressed Ctrl-C wants the program to stop.
        status = IpoptStatus.INTERRUPTED
    if np.isnan(objective.value) or np.isnan(g).any():
        # Ipopt hands out nothing when it stops before its first iteration.
        with contextlib.suppress(EvaluationError):
            g, objective.value = nlp.constraints(point), nlp.objective(point)
    return IpoptOutcome(
        status=status,
        x=point,
        objective=objective.value,
        g=g,
        g_multipliers=row_multipliers,
        lower_multipliers=lower,
        upper_multipliers=upper,
        iterations=callbacks.records[-1].iteration if callbacks.records else 0,
        records=callbacks.records,
        seconds=time.perf_counter() - started,
        cpu_seconds=time.process_time() - cpu_started,
        evaluation_seconds=callbacks.seconds,
        log=log.getvalue(),
        undefined_at=callbacks.undefined_at,
    )


def _time_limit(options: Mapping[str, Any], deadline: Deadline) -> dict[str, float]:
    """What is left, unless the caller's own limit is shorter; Ipopt takes no limit of zero."""
    if deadline.left is None:
        return {}
    return {"max_wall_time": max(min(deadline.left, float(options.get("max_wall_time", deadline.left))), 1e-3)}


def _vector(values: Any, size: int, name: str) -> FloatArray:
    """A copy that Ipopt may overwrite."""
    vector = np.array(values, dtype=np.float64)
    if vector.shape != (size,):
        raise ValueError(f"'{name}' has shape {vector.shape}; this problem needs ({size},).")
    return vector


def _set_scaling(library: IpoptLibrary, problem: int, nlp: NonlinearProgram, scaling: ProblemScaling) -> None:
    x = None if scaling.x is None else _vector(scaling.x, nlp.n, "scaling.x")
    g = None if scaling.g is None else _vector(scaling.g, nlp.m, "scaling.g")
    library.functions.SetIpoptProblemScaling(  # Ipopt copies the factors
        problem, scaling.objective, None if x is None else x.ctypes.data, None if g is None else g.ctypes.data
    )
