"""Engines by their names: in this process, with which all others have to agree, and on any executor."""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from typing import Any
from uuid import uuid4

from pyrobocop_pyomo.errors import EngineError
from pyrobocop_pyomo.modeling.deadline import stoppable_thread
from pyrobocop_pyomo.optional_imports import distributed, mpi, mpi_futures

from .engine import Engine
from .process_engine import UNPROTECTED, ProcessEngine, check_protection
from .worker_host import Answer, Request, WorkerHost

Opener = Callable[[int], AbstractContextManager[Executor]]
_LAST = threading.local()  # in a worker: the engine that has asked last, and its host; threads share no models


class SerialEngine(Engine):
    """All agents in this process, one after the other.

    Needs nothing, starts at once, and any builder will do. Orders and reports are pickled here too, so that no array is
    shared by accident.
    """

    name = "serial"
    in_this_process = True

    def __init__(self) -> None:
        super().__init__(1)

    def open(self, places: int) -> None:
        """Begin with no agents."""
        self._host = WorkerHost()

    def submit(self, request: Request) -> Future[Answer]:
        """Answer a request."""
        future: Future[Answer] = Future()
        future.set_result(self._host.answer(request))
        return future

    def close(self) -> None:
        """Forget the agents."""
        self.open(1)


class ExecutorEngine(Engine):
    """Workers of an executor of `concurrent.futures`: ``ProcessPoolExecutor``, ``MPIPoolExecutor``, Dask, and others.

    An agent is at work wherever the executor sends it: it is built on a worker where it has not been, and put into its
    last state where it was elsewhere meanwhile. What a dead worker has not answered is requested again, where the
    executor goes on. The executor is not shut down.

    Parameters
    ----------
    executor : concurrent.futures.Executor, or callable
        Of processes or threads. Its workers need this package in the same version. Or what opens
        one with so many workers, as a context.
    workers : int
        How many it has.
    deaths_allowed
        As of `Engine`.

    Raises
    ------
    EngineError
        When `workers` is no such number; and later, when the executor takes no more work.

    Examples
    --------
    >>> from concurrent.futures import ProcessPoolExecutor
    >>> with ProcessPoolExecutor(4) as executor:  # doctest: +SKIP
    ...     result = team.solve(engine=rcp.teams.ExecutorEngine(executor, workers=4))
    """

    name = "executor"

    def __init__(self, executor: Executor | Opener, workers: int | None, *, deaths_allowed: int = 2) -> None:
        super().__init__(workers, deaths_allowed=deaths_allowed)
        self._given = executor
        self._opened = ExitStack()

    def open(self, places: int) -> None:
        """Begin with no agents."""
        self._key = uuid4().hex
        context = nullcontext(self._given) if isinstance(self._given, Executor) else self._given(places)
        self._executor = self._opened.enter_context(context)

    def submit(self, request: Request) -> Future[Answer]:
        """Have a request answered by a worker that the executor chooses."""
        try:
            return self._executor.submit(_answer_in_worker, self._key, uuid4().hex, request)
        except RuntimeError as error:  # of an executor that is broken, or was shut down
            raise EngineError(
                f"engine '{self.name}': the executor takes no more work ({type(error).__name__}: {error}). Make a new "
                "one; or take engine='process', which goes on when workers die."
            ) from error

    def close(self) -> None:
        """End an executor that was opened here; a given one goes on."""
        self._opened.close()


def _answer_in_worker(engine: str, number: str, request: Request) -> Answer:
    """What a worker does; no two calls are alike, since Dask keeps what a call with the same arguments gave."""
    if getattr(_LAST, "engine", None) != engine:
        _LAST.engine, _LAST.host = engine, WorkerHost()
    try:
        with stoppable_thread():
            answer: Answer = _LAST.host.answer(request)
    except SystemExit as error:  # else it would end the caller's process, by the future
        raise RuntimeError(f"a worker was told to end by sys.exit({error.code!r})") from error
    return answer


def dask_engine(workers: int | None = None, **of_engine: Any) -> ExecutorEngine:
    """An engine with a cluster of Dask on this machine, which ends with it."""
    return ExecutorEngine(_dask_here, workers, **of_engine)


@contextmanager
def _dask_here(workers: int) -> Iterator[Executor]:
    check_protection()
    try:
        client = distributed.Client(
            set_as_default=False,
            n_workers=workers,
            processes=True,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",  # none would take a port that another cluster may have
            silence_logs=logging.CRITICAL,
            scheduler_kwargs={"allowed_failures": 0},  # deaths are counted here
            preload=[__name__],
        )
    except (RuntimeError, OSError, TimeoutError) as error:
        raise EngineError(f"engine 'dask': no workers could be started here: {error}. {UNPROTECTED}") from error
    with client:  # and its cluster
        yield client.get_executor()


def dask_setup(worker: Any) -> None:
    """What every worker of Dask does when it starts: ignore Ctrl-C, which reaches the whole group of processes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def mpi_engine() -> ExecutorEngine:
    """An engine on all ranks of an MPI job but the first, which runs the script.

    Raises
    ------
    EngineError
        When there are no others, or this is one of them.
    """
    if mpi.COMM_WORLD.size == 1 or mpi.COMM_WORLD.rank != 0:
        raise EngineError(
            "engine 'mpi': one rank runs the script, the others are its workers. Start it with: mpiexec -n 4 python -m "
            "mpi4py.futures script.py"
        )
    return ExecutorEngine(mpi_futures.MPIPoolExecutor(), mpi.COMM_WORLD.size - 1)


ENGINES: dict[str, Callable[[], Engine]] = {
    "serial": SerialEngine,
    "process": ProcessEngine,
    "dask": dask_engine,
    "mpi": mpi_engine,
}


def find_engine(engine: str | Engine) -> Engine:
    """Look an engine up.

    Parameters
    ----------
    engine : str or Engine
        ``"serial"``, ``"process"``, ``"dask"`` or ``"mpi"``; an engine is given back as it is.

    Returns
    -------
    Engine
        Not started.

    Raises
    ------
    EngineError
        When there is no such engine.
    """
    if isinstance(engine, Engine):
        return engine
    if engine not in ENGINES:
        raise EngineError(f"engine = {engine!r}; expected {', '.join(map(repr, ENGINES))}, or an Engine.")
    return ENGINES[engine]()
