"""One run of Ipopt in this process, with everything that can happen during it."""

from __future__ import annotations

import contextlib
import ctypes
import difflib
import io
import logging
import numbers
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any, TextIO

import numpy as np
from pyomo.common.tee import redirect_fd

from pyrobocop_pyomo.errors import EvaluationError, ModelError
from pyrobocop_pyomo.modeling.deadline import NO_DEADLINE, Deadline, is_stopped
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram, PrimalDualPoint, ProblemScaling
from pyrobocop_pyomo.programs.vectorised_program import EVALUATIONS, compiled_run_of

from .backends import EvalF, EvalG, EvalGradF, EvalH, EvalJacG, Intermediate, IpoptLibrary, load_ipopt_library
from .ipopt_outcome import IpoptOutcome, IpoptStatus, IterationRecord
from .linear_solvers import FALL_BACK, IN_DOUBT, OWN_SOLVER, SAID_OF_OWN_SOLVER, refused_options, with_linear_solver

OnIteration = Callable[[IterationRecord], bool | None]


@contextlib.contextmanager
def first_ctrl_c(request: Callable[[], None]) -> Iterator[None]:
    """Let the first Ctrl-C call a function, which asks the run to end.

    The second Ctrl-C finds the handler that was there before (usually the one that raises `KeyboardInterrupt`).
    Outside of the main thread Python gives no access to signals, and this does nothing.
    """
    in_main_thread = threading.current_thread() is threading.main_thread()
    previous = signal.getsignal(signal.SIGINT)
    # None: a handler that C code installed, which Python could not put back. Ignored: leave it ignored.
    if not in_main_thread or previous in (None, signal.SIG_IGN):
        yield
        return

    def pressed(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, previous)
        request()

    signal.signal(signal.SIGINT, pressed)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)


class IpoptCallbacks:
    """The functions that Ipopt calls during one run.

    Parameters
    ----------
    nlp : NonlinearProgram
        What is evaluated.
    on_iteration : callable or None
        The user's callback.

    Attributes
    ----------
    records : list of IterationRecord
        What Ipopt reported so far.
    failure : exception or None
        What was raised in a callback: no exception may leave it, since it would be lost inside C code.
    after_record : callable or None
        Called after each iteration, before the user's callback.
    evaluators, intermediate : ctypes callbacks
        As Ipopt's C interface takes them. The evaluators are C functions where the program has some,
        else call Python.
    data : int or None
        What Ipopt hands to the evaluators.
    interrupted : bool
        Whether the run is to end after the iteration.
    """

    def __init__(self, nlp: NonlinearProgram, on_iteration: OnIteration | None) -> None:
        self.nlp = nlp
        self._compiled = compiled_run_of(nlp)
        self.data = None if self._compiled is None else self._compiled.data
        self.begin(on_iteration)
        functions: Mapping[str, Any] = (
            {name: partial(self._answered, self._evaluate, name) for name in EVALUATIONS}
            if self._compiled is None
            else self._compiled.functions
        )
        kinds = (EvalF, EvalG, EvalGradF, EvalJacG, EvalH)
        # ctypes does not keep callbacks alive: these attributes do, for as long as the problem exists.
        self.evaluators: tuple[Any, ...] = tuple(
            kind(functions[name]) for kind, name in zip(kinds, EVALUATIONS, strict=True)
        )
        self.intermediate: Any = Intermediate(self._intermediate)

    def begin(self, on_iteration: OnIteration | None) -> None:
        """Forget the run before; the next one has its own callback and its own Ctrl-C."""
        self.on_iteration = on_iteration
        self.interrupted = False
        self.records: list[IterationRecord] = []
        self.failure: BaseException | None = None
        self._undefined_at: FloatArray | None = None
        if self._compiled is not None:
            self._compiled.begin()
        self.after_record: Callable[[], None] | None = None

    def interrupt(self) -> None:
        """End the run after the iteration."""
        self.interrupted = True

    def release(self) -> None:
        """Break the cycle of callbacks and their owner, which would keep the program in memory for a while."""
        self.evaluators, self.intermediate = (), None

    @property
    def undefined_at(self) -> FloatArray | None:
        """The last point at which a value or a derivative did not exist."""
        compiled = None if self._compiled is None else self._compiled.undefined_at
        return self._undefined_at if compiled is None else compiled

    def _answered(self, answer: Callable[..., int], *arguments: Any) -> int:
        """What Ipopt is told; 0 after an exception, which is raised again after Ipopt, a KeyboardInterrupt as well."""
        try:
            return 0 if self.failure is not None else answer(*arguments)
        except BaseException as error:
            self.failure = error
            return 0

    def _evaluate(self, name: str, n: int, address: int, new_x: int, *others: Any) -> int:
        """Put what a function of the program gives where Ipopt wants it; 0 tells Ipopt that there is nothing."""
        *given, to, _ = others
        structure = EVALUATIONS[name]
        if structure is not None and not to:
            for indices, places in zip(getattr(self.nlp, structure), given[-2:], strict=True):
                _view(places, indices.size, ctypes.c_int)[...] = indices
            return 1
        arguments: list[Any] = [_view(address, n)]
        if name == "hessian":
            factor, m, multipliers, *_ = given
            arguments += [factor, _view(multipliers, m)]
        try:
            values = np.asarray(getattr(self.nlp, name)(*arguments), dtype=np.float64)
        except EvaluationError:
            values = np.array(np.nan)
        if not np.isfinite(values).all():
            self._undefined_at = arguments[0].copy()  # Ipopt's own memory
            return 0
        _view(to, values.size)[...] = values.ravel()
        return 1

    def _intermediate(self, mode: int, iteration: int, *numbers: Any) -> int:
        record = IterationRecord(iteration, mode == 1, *numbers[:-1])
        self.records.append(record)
        return self._answered(self._continued, record)

    def _continued(self, record: IterationRecord) -> int:
        """1 where Ipopt may go on after an iteration."""
        if self.after_record is not None:
            self.after_record()
        self.interrupted = self.interrupted or is_stopped()
        if self.interrupted:
            return 0
        return int(self.on_iteration is None or self.on_iteration(record) is not False)


def _view(address: int | None, size: int, kind: Any = ctypes.c_double) -> np.ndarray[Any, Any]:
    """Ipopt's memory as an array, valid during one callback."""
    if not size or not address:
        return np.empty(0)
    return np.ctypeslib.as_array((kind * size).from_address(address))


class KeptProblem:
    """Keeps Ipopt's problem object from one run to the next: making and freeing one takes most of a millisecond.

    It is made anew for another program, other bounds or options of other names. Ipopt never forgets an option, so a
    run that does not set it would be given what an earlier one has set.
    """

    def __init__(self) -> None:
        self._address: int | None = None
        self._library: IpoptLibrary | None = None
        self._callbacks: IpoptCallbacks | None = None
        self._made_for: tuple[Any, ...] = ()
        self._busy = False

    @contextlib.contextmanager
    def opened(
        self, library: IpoptLibrary, nlp: NonlinearProgram, names: frozenset[str], on_iteration: OnIteration | None
    ) -> Iterator[tuple[int, IpoptCallbacks]]:
        """The address of a problem object for one run, and its callbacks.

        Parameters
        ----------
        library : IpoptLibrary
        nlp : NonlinearProgram
        names : frozenset of str
            Of the options that the run sets, and of whatever else stays on the object.
        on_iteration : callable or None
            The user's callback.

        Raises
        ------
        MemoryError
            When Ipopt makes no object.
        """
        if self._busy:  # a run within a callback of a run
            with contextlib.closing(KeptProblem()) as own, own.opened(library, nlp, names, on_iteration) as opened:
                yield opened
            return
        bounds = [np.array(bound, dtype=np.float64) for bound in (nlp.x_lower, nlp.x_upper, nlp.g_lower, nlp.g_upper)]
        made_for = (library, nlp, names, *(bound.tobytes() for bound in bounds))
        if self._callbacks is not None and self._made_for == made_for:
            self._callbacks.begin(on_iteration)
        else:
            self.close()
            self._callbacks = IpoptCallbacks(nlp, on_iteration)
            self._address = library.functions.CreateIpoptProblem(  # Ipopt copies the bounds
                nlp.n, bounds[0].ctypes.data, bounds[1].ctypes.data, nlp.m, bounds[2].ctypes.data,
                bounds[3].ctypes.data, nlp.jacobian_structure[0].size, nlp.hessian_structure[0].size, 0,
                *self._callbacks.evaluators,
            )  # fmt: skip
            self._library, self._made_for = library, made_for
            if not self._address:
                self.close()
                raise MemoryError(f"Ipopt could not create a problem with {nlp.n} variables and {nlp.m} rows.")
            library.functions.SetIntermediateCallback(self._address, self._callbacks.intermediate)
        self._busy = True
        try:
            yield self._address, self._callbacks  # type: ignore[misc]
        finally:
            self._busy = False

    def close(self) -> None:
        """Free the object; the next run makes another one."""
        address, library, callbacks = self._address, self._library, self._callbacks
        self._address = self._library = self._callbacks = None
        self._made_for = ()
        if address and library is not None:
            library.functions.FreeIpoptProblem(address)
        if callbacks is not None:
            callbacks.release()

    def __del__(self) -> None:
        self.close()

    def __reduce__(self) -> tuple[Any, ...]:
        # In a copy or in another process there is no such object yet.
        return KeptProblem, ()


logger = logging.getLogger(__name__)


def run_ipopt(
    nlp: NonlinearProgram,
    options: Mapping[str, Any],
    start: PrimalDualPoint | None = None,
    *,
    deadline: Deadline = NO_DEADLINE,
    scaling: ProblemScaling | None = None,
    on_iteration: OnIteration | None = None,
    output: Sequence[TextIO] = (),
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
        First point and multipliers, by default ``nlp.x_start`` and the multipliers of `PrimalDualPoint.complete`.
    deadline : Deadline
        Ipopt stops after the first iteration that ends later.
    scaling : ProblemScaling, optional
        Factors that Ipopt uses when ``nlp_scaling_method`` is ``"user-scaling"`` among the options.
    on_iteration : callable, optional
        Called with the `IterationRecord` of each iteration; stops Ipopt by returning False.
    output : sequence of text streams
        Where Ipopt's own log goes; it is silent when there is none.
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
    outcome = _run_once(nlp, resolved, start, kept, deadline=deadline, head=SAID_OF_OWN_SOLVER if own else "", **how)
    if not own:
        return outcome
    if outcome.status not in IN_DOUBT:
        return replace(outcome, linear_solver=OWN_SOLVER)
    logger.info("with the linear solver of this package: %s MUMPS has a try.", outcome.status.value)
    again = _run_once(nlp, {**options, **FALL_BACK}, start, None, deadline=deadline, head="", **how)
    return replace(
        again,
        seconds=outcome.seconds + again.seconds,
        log=outcome.log + again.log,
        fell_back=True,
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
    library = load_ipopt_library()
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
    started = time.perf_counter()
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="pyrobocop_"))) if output else None
        if kept is None or scaling is not None or output:
            kept = KeptProblem()
            stack.callback(kept.close)
        problem, callbacks = stack.enter_context(kept.opened(library, nlp, frozenset(settings), on_iteration))
        if scaling is not None:
            factors = _vector(scaling.x, nlp.n, "scaling.x"), _vector(scaling.g, nlp.m, "scaling.g")
            addresses = [factor.ctypes.data for factor in factors]  # Ipopt copies the factors
            library.functions.SetIpoptProblemScaling(problem, scaling.objective, *addresses)
        set_options(library, problem, settings)
        if folder is not None:
            level = int(float(settings.get("print_level", 5)))
            library.functions.OpenIpoptOutputFile(problem, str(folder / "log").encode(), level)
            written = stack.enter_context(open(folder / "log", encoding="utf-8", errors="replace"))
            callbacks.after_record = partial(_pass_on, written, (log, *output))
            _pass_on(io.StringIO(head), (log, *output))
        stack.enter_context(first_ctrl_c(callbacks.interrupt))
        code = library.functions.IpoptSolve(
            problem, point.ctypes.data, g.ctypes.data, ctypes.addressof(objective),
            row_multipliers.ctypes.data, lower.ctypes.data, upper.ctypes.data, callbacks.data,
        )  # fmt: skip
        if folder is not None:
            kept.close()  # Ipopt closes its file
            _pass_on(written, (log, *output))
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
        log=log.getvalue(),
        undefined_at=callbacks.undefined_at,
    )


def _pass_on(written: TextIO, streams: Iterable[TextIO]) -> None:
    """Write what Ipopt has written to its file since the last time."""
    text = written.read()
    for stream in streams:
        stream.write(text)
        stream.flush()


def _time_limit(options: Mapping[str, Any], deadline: Deadline) -> dict[str, float]:
    """The time that is left, unless the caller's own limit is shorter; Ipopt takes no limit of zero."""
    if deadline.left is None:
        return {}
    return {"max_wall_time": max(min(deadline.left, float(options.get("max_wall_time", deadline.left))), 1e-6)}


def _vector(values: Any, size: int, name: str) -> FloatArray:
    """A copy that Ipopt may overwrite."""
    vector = np.array(values, dtype=np.float64)
    if vector.shape != (size,):
        raise ValueError(f"'{name}' has shape {vector.shape}; this problem needs ({size},).")
    return vector


# Names that are requested often, for "Did you mean".
FREQUENT_OPTIONS = (
    "acceptable_iter", "acceptable_tol", "bound_push", "bound_relax_factor", "compl_inf_tol", "constr_viol_tol",
    "dual_inf_tol", "file_print_level", "hessian_approximation", "linear_solver", "max_cpu_time", "max_iter",
    "max_wall_time", "mu_init", "mu_strategy", "mu_target", "nlp_scaling_method", "output_file", "print_level",
    "print_timing_statistics", "tol", "warm_start_init_point",
)  # fmt: skip
_ADDED_BY = {str: "AddIpoptStrOption", int: "AddIpoptIntOption", float: "AddIpoptNumOption"}
# What a library has accepted once, and as what: it need not be watched again for what it prints, which takes a third of
# a millisecond.
_ACCEPTED: dict[tuple[str, ...], str | int | float] = {}


def set_options(library: IpoptLibrary, problem: int, options: Mapping[str, Any]) -> None:
    """Hand options to Ipopt's problem, which prints nothing to standard output.

    Parameters
    ----------
    library : IpoptLibrary
        The library that `problem` belongs to.
    problem : int
        Address of Ipopt's problem.
    options : mapping of str to str, int, float or bool
        Each value is tried as what it is and then as what it can stand for: ``1`` as a number, ``"100"`` and
        ``100.0`` as integers, as the ``ipopt`` executable takes them.

    Raises
    ------
    ModelError
        When Ipopt refuses one.
    """
    settings = [*options.items(), ("print_level", 0), ("sb", "yes")]
    # Ipopt prints an explanation of each refused attempt, also of those that merely guessed the wrong type.
    is_known = all(_key(library, name, value) in _ACCEPTED for name, value in settings)
    with contextlib.nullcontext(list[str]()) if is_known else _explanations() as explanations:
        refused = next((name for name, value in settings if not _set(library, problem, name, value)), None)
    if refused is not None:
        told = "".join(explanations)
        raise ModelError(
            f"Ipopt option '{refused}': the value {options[refused]!r} is refused by {library}. "
            f"{_last_explanation(told)}{_nearest(refused, told)} "
            "See https://coin-or.github.io/Ipopt/OPTIONS.html for names and values."
        )


# The descriptor of standard output belongs to all threads: one at a time changes where it leads.
_DESCRIPTOR = threading.Lock()


@contextlib.contextmanager
def _explanations() -> Iterator[list[str]]:
    """What Ipopt prints to standard output meanwhile, as one text or none; nothing while another thread asks for that.

    Pyomo's ``capture_output`` starts threads, which is too much for microseconds.
    """
    told: list[str] = []
    with contextlib.ExitStack() as stack:
        if sys.stdout is None or not _DESCRIPTOR.acquire(blocking=False):
            yield told
            return
        stack.callback(_DESCRIPTOR.release)
        file = stack.enter_context(tempfile.TemporaryFile())
        _flush()
        with redirect_fd(1, file.fileno(), synchronize=False):
            yield told
            _flush()
        file.seek(0)
        told.append(file.read().decode(errors="replace"))


def _flush() -> None:
    """Push out what Python and C code have printed and not yet written, where they can."""
    with contextlib.suppress(ValueError, OSError):
        sys.stdout.flush()
    with contextlib.suppress(TypeError, OSError, AttributeError):
        ctypes.CDLL(None).fflush(None)


def _nearest(name: str, explanation: str) -> str:
    """Which option may be meant, where Ipopt knows none of this name."""
    near = difflib.get_close_matches(name, FREQUENT_OPTIONS, n=1) if "not a valid option" in explanation else []
    return f" Did you mean '{near[0]}'?" if near else ""


def _last_explanation(text: str) -> str:
    """The sentence about the last attempt, and the allowed range, out of all that Ipopt printed."""
    lines = [line.strip() for line in text.splitlines()]
    sentences = [line for line in lines if line.startswith(("Tried to set", "Setting:"))]
    ranges = [line for line in lines if "<" in line and "(" in line]
    told = sentences[-1] if sentences else "Ipopt gives no reason."
    return f"{told} Allowed, with the default in brackets: {ranges[-1]}." if ranges else told


def _key(library: IpoptLibrary, name: str, value: Any) -> tuple[str, ...]:
    return library.path, name, type(value).__name__, repr(value)


def _set(library: IpoptLibrary, problem: int, name: str, value: Any) -> bool:
    known = _key(library, name, value)
    for attempt in [_ACCEPTED[known]] if known in _ACCEPTED else possible_values(name, value):
        add = getattr(library.functions, _ADDED_BY[type(attempt)])
        if add(problem, name.encode(), attempt.encode() if isinstance(attempt, str) else attempt):
            _ACCEPTED[known] = attempt
            return True
    return False


def possible_values(name: str, value: Any) -> list[str | int | float]:
    """What the value of an option can mean to Ipopt, most literal first.

    Raises
    ------
    ModelError
        When it is neither text nor a number.
    """
    if isinstance(value, bool):
        return ["yes" if value else "no"]
    if isinstance(value, str):
        try:
            return [value, *possible_values(name, float(value))]
        except ValueError:
            return [value]
    if isinstance(value, numbers.Real):
        number = float(value)
        # ctypes would wrap an integer beyond 32 bits silently.
        whole = [int(number)] if number.is_integer() and abs(number) < 2**31 else []
        return [*whole, number] if isinstance(value, numbers.Integral) else [number, *whole]
    raise ModelError(f"Ipopt option '{name}': the value {value!r} is neither text nor a number.")
