"""One run of Ipopt in this process, with everything that can happen during it."""

from __future__ import annotations

import contextlib
import ctypes
import io
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TextIO

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError

from .c_output import c_output_sent_to, flush_c_streams
from .interruption import Interruption
from .ipopt_library import EvalF, EvalG, EvalGradF, EvalH, EvalJacG, Intermediate, IpoptLibrary
from .ipopt_options import set_options
from .ipopt_outcome import STATUS_OF_RETURN_CODE, IpoptOutcome, IpoptStatus, IterationRecord
from .nonlinear_program import FloatArray, NonlinearProgram


class ProblemScaling(NamedTuple):
    """Factors for the objective, the variables and the rows; None stands for ones."""

    objective: float = 1.0
    x: FloatArray | None = None
    g: FloatArray | None = None


def run_ipopt(
    library: IpoptLibrary,
    nlp: NonlinearProgram,
    options: Mapping[str, Any],
    *,
    x: FloatArray | None = None,
    g_multipliers: FloatArray | None = None,
    lower_multipliers: FloatArray | None = None,
    upper_multipliers: FloatArray | None = None,
    scaling: ProblemScaling | None = None,
    on_iteration: Callable[[IterationRecord], bool | None] | None = None,
    output: Sequence[TextIO] = (),
) -> IpoptOutcome:
    """Solve a nonlinear program with Ipopt, in this process.

    Parameters
    ----------
    library : IpoptLibrary
        From `load_ipopt_library`.
    nlp : NonlinearProgram
        The problem.
    options : mapping of str to str, int, float or bool
        Ipopt's options. Multipliers are used when ``warm_start_init_point`` is ``"yes"`` among them.
    x : float array, shape (n,), optional
        First point, by default ``nlp.x_start``.
    g_multipliers, lower_multipliers, upper_multipliers : float array, optional
        First multipliers in Ipopt's signs; by default 0 (or ``nlp.g_multipliers_start``), 1 and 1.
    scaling : ProblemScaling, optional
        Factors that Ipopt uses when ``nlp_scaling_method`` is ``"user-scaling"`` among the options.
    on_iteration : callable, optional
        Called with the `IterationRecord` of each iteration; stops Ipopt by returning False.
    output : sequence of text streams
        Where Ipopt's own log goes; it is silent when there is none.

    Returns
    -------
    IpoptOutcome
        Also after a limit, an interruption or a failure, with the last point.

    Raises
    ------
    SolverOptionError
        For an option that Ipopt does not know, or a value that it refuses.
    Exception
        What a callback raised, after Ipopt has returned. An `EvaluationError` is none of them: Ipopt then tries a
        shorter step.
    """
    point = _vector(nlp.x_start if x is None else x, nlp.n, "x")
    if g_multipliers is None:
        g_multipliers = nlp.g_multipliers_start if nlp.g_multipliers_start is not None else np.zeros(nlp.m)
    row_multipliers = _vector(g_multipliers, nlp.m, "g_multipliers")
    lower = _vector(np.ones(nlp.n) if lower_multipliers is None else lower_multipliers, nlp.n, "lower_multipliers")
    upper = _vector(np.ones(nlp.n) if upper_multipliers is None else upper_multipliers, nlp.n, "upper_multipliers")
    g, objective = np.full(nlp.m, np.nan), ctypes.c_double(np.nan)
    interruption = Interruption()
    callbacks = _Callbacks(nlp, on_iteration, interruption)
    log = io.StringIO()
    started, cpu_started = time.perf_counter(), time.process_time()
    with contextlib.ExitStack() as stack:
        if output:
            stack.enter_context(c_output_sent_to([log, *output]))
            callbacks.after_record = flush_c_streams
        problem = stack.enter_context(_problem(library, nlp, callbacks))
        if scaling is not None:
            _set_scaling(library, problem, nlp, scaling)
        set_options(library, problem, options, silent=not output)
        stack.enter_context(interruption)
        code = library.functions.IpoptSolve(
            problem, point.ctypes.data, g.ctypes.data, ctypes.addressof(objective),
            row_multipliers.ctypes.data, lower.ctypes.data, upper.ctypes.data, None,
        )  # fmt: skip
    if callbacks.failure is not None:
        raise callbacks.failure
    status = STATUS_OF_RETURN_CODE.get(code, IpoptStatus.INTERNAL_ERROR)
    if interruption.requested:
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
    )


def _vector(values: Any, size: int, name: str) -> FloatArray:
    """A copy that Ipopt may overwrite."""
    vector = np.array(values, dtype=np.float64)
    if vector.shape != (size,):
        raise ValueError(f"'{name}' has shape {vector.shape}; this problem needs ({size},).")
    return vector


@contextlib.contextmanager
def _problem(library: IpoptLibrary, nlp: NonlinearProgram, callbacks: _Callbacks) -> Any:
    """Ipopt's problem object, freed in every case."""
    # Ipopt copies the bounds; the arrays need to live through this call only.
    bounds = [np.array(b, dtype=np.float64) for b in (nlp.x_lower, nlp.x_upper, nlp.g_lower, nlp.g_upper)]
    problem = library.functions.CreateIpoptProblem(
        nlp.n, bounds[0].ctypes.data, bounds[1].ctypes.data, nlp.m, bounds[2].ctypes.data, bounds[3].ctypes.data,
        nlp.jacobian_structure[0].size, nlp.hessian_structure[0].size, 0, *callbacks.evaluators,
    )  # fmt: skip
    if not problem:
        raise MemoryError(f"Ipopt could not create a problem with {nlp.n} variables and {nlp.m} rows.")
    try:
        library.functions.SetIntermediateCallback(problem, callbacks.intermediate)
        yield problem
    finally:
        library.functions.FreeIpoptProblem(problem)
        callbacks.release()


def _set_scaling(library: IpoptLibrary, problem: int, nlp: NonlinearProgram, scaling: ProblemScaling) -> None:
    x = None if scaling.x is None else _vector(scaling.x, nlp.n, "scaling.x")
    g = None if scaling.g is None else _vector(scaling.g, nlp.m, "scaling.g")
    library.functions.SetIpoptProblemScaling(  # Ipopt copies the factors
        problem, scaling.objective, None if x is None else x.ctypes.data, None if g is None else g.ctypes.data
    )


class _Callbacks:
    """The functions that Ipopt calls. No exception may leave them: it would be lost inside C code."""

    def __init__(
        self,
        nlp: NonlinearProgram,
        on_iteration: Callable[[IterationRecord], bool | None] | None,
        interruption: Interruption,
    ) -> None:
        self.nlp = nlp
        self.on_iteration = on_iteration
        self.interruption = interruption
        self.records: list[IterationRecord] = []
        self.failure: BaseException | None = None
        self.seconds = 0.0
        self.after_record: Callable[[], None] | None = None
        # ctypes does not keep callbacks alive: these attributes do, for as long as the problem exists.
        self.evaluators: tuple[Any, ...] = (
            EvalF(self._eval_f), EvalG(self._eval_g), EvalGradF(self._eval_grad_f),
            EvalJacG(self._eval_jac_g), EvalH(self._eval_h),
        )  # fmt: skip
        self.intermediate: Any = Intermediate(self._intermediate)

    def release(self) -> None:
        """Break the cycle of callbacks and their owner, which would keep the program in memory for a while."""
        self.evaluators, self.intermediate = (), None

    def _write(self, address: int, evaluate: Callable[..., Any], *arguments: Any) -> int:
        """Put the value of a function where Ipopt wants it; 0 tells Ipopt that there is none."""
        if self.failure is not None:
            return 0
        started = time.perf_counter()
        try:
            values = np.asarray(evaluate(*arguments), dtype=np.float64)
            if not np.isfinite(values).all():
                return 0
            _view(address, values.size)[...] = values.ravel()
            return 1
        except EvaluationError:
            return 0
        except BaseException as error:  # a KeyboardInterrupt as well: it is raised again after Ipopt
            self.failure = error
            return 0
        finally:
            self.seconds += time.perf_counter() - started

    def _eval_f(self, n: int, x: int, new_x: int, value: int, data: Any) -> int:
        return self._write(value, self.nlp.objective, _view(x, n))

    def _eval_grad_f(self, n: int, x: int, new_x: int, values: int, data: Any) -> int:
        return self._write(values, self.nlp.gradient, _view(x, n))

    def _eval_g(self, n: int, x: int, new_x: int, m: int, values: int, data: Any) -> int:
        return self._write(values, self.nlp.constraints, _view(x, n))

    def _eval_jac_g(
        self, n: int, x: int, new_x: int, m: int, count: int, rows: int, columns: int, values: int, data: Any
    ) -> int:
        if not values:
            return _write_structure(self.nlp.jacobian_structure, rows, columns)
        return self._write(values, self.nlp.jacobian, _view(x, n))

    def _eval_h(
        self, n: int, x: int, new_x: int, factor: float, m: int, multipliers: int, new_multipliers: int, count: int,
        rows: int, columns: int, values: int, data: Any,
    ) -> int:  # fmt: skip
        if not values:
            return _write_structure(self.nlp.hessian_structure, rows, columns)
        return self._write(values, self.nlp.hessian, _view(x, n), factor, _view(multipliers, m))

    def _intermediate(
        self, mode: int, iteration: int, objective: float, primal: float, dual: float, mu: float, step: float,
        regularization: float, dual_step: float, primal_step: float, trials: int, data: Any,
    ) -> int:  # fmt: skip
        record = IterationRecord(
            iteration, mode == 1, objective, primal, dual, mu, step, regularization, dual_step, primal_step, trials
        )
        try:
            self.records.append(record)
            if self.after_record is not None:
                self.after_record()
            if self.failure is not None or self.interruption.requested:
                return 0
            if self.on_iteration is not None:
                return int(self.on_iteration(record) is not False)
        except BaseException as error:
            self.failure = error
            return 0
        return 1


def _view(address: int | None, size: int) -> FloatArray:
    """Ipopt's memory as an array, valid during one callback."""
    if not size or not address:
        return np.empty(0)
    return np.ctypeslib.as_array((ctypes.c_double * size).from_address(address))


def _write_structure(structure: tuple[Any, Any], rows: int, columns: int) -> int:
    for indices, address in zip(structure, (rows, columns), strict=True):
        if indices.size:
            np.ctypeslib.as_array((ctypes.c_int * indices.size).from_address(address))[:] = indices
    return 1
