"""Between Ipopt's C interface and a nonlinear program in Python: callbacks, Ctrl-C meanwhile, the problem object."""

from __future__ import annotations

import ctypes
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from types import FrameType
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.programs.compiled_run import EVALUATIONS, compiled_functions_of
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram

from .ipopt_library import EvalF, EvalG, EvalGradF, EvalH, EvalJacG, Intermediate, IpoptLibrary
from .ipopt_outcome import IterationRecord

OnIteration = Callable[[IterationRecord], bool | None]


@contextmanager
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
        self._compiled, compiled = compiled_functions_of(nlp)
        self.data = None if self._compiled is None else self._compiled.data
        self.begin(on_iteration)
        in_python = self._eval_f, self._eval_g, self._eval_grad_f, self._eval_jac_g, self._eval_h
        functions: dict[str, Any] = {**dict(zip(EVALUATIONS, in_python, strict=True)), **compiled}
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
        self._seconds = 0.0
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
    def seconds(self) -> float:
        """Time inside the evaluations so far."""
        return self._seconds + (0.0 if self._compiled is None else self._compiled.seconds)

    @property
    def undefined_at(self) -> FloatArray | None:
        """The last point at which a value or a derivative did not exist."""
        compiled = None if self._compiled is None else self._compiled.undefined_at
        return self._undefined_at if compiled is None else compiled

    def _write(self, address: int, evaluate: Callable[..., Any], *arguments: Any) -> int:
        """Put the value of a function where Ipopt wants it; 0 tells Ipopt that there is none."""
        if self.failure is not None:
            return 0
        started = time.perf_counter()
        try:
            values = np.asarray(evaluate(*arguments), dtype=np.float64)
            if not np.isfinite(values).all():
                self._undefined_at = arguments[0].copy()
                return 0
            _view(address, values.size)[...] = values.ravel()
            return 1
        except EvaluationError:
            self._undefined_at = arguments[0].copy()  # Ipopt's own memory
            return 0
        except BaseException as error:  # a KeyboardInterrupt as well: it is raised again after Ipopt
            self.failure = error
            return 0
        finally:
            self._seconds += time.perf_counter() - started

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
            if self.failure is not None or self.interrupted:
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

    @property
    def library(self) -> IpoptLibrary | None:
        """What the object was made by: looking for a library in each run takes a tenth of a millisecond."""
        return self._library

    @contextmanager
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
            with closing(KeptProblem()) as own, own.opened(library, nlp, names, on_iteration) as opened:
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
