"""`ExecutorEngine`: any executor of `concurrent.futures`, such as a pool of processes or a client of Dask."""

from __future__ import annotations

import contextlib
import itertools
import logging
import signal
from concurrent.futures import Executor, Future
from typing import Any
from uuid import uuid4

from pyrobocop_pyomo.errors import EngineError
from pyrobocop_pyomo.optional_imports import distributed, distributed_available

from .engine import Engine
from .process_engine import UNPROTECTED, check_protection
from .worker_host import Answer, Request, WorkerHost

_HOSTS: dict[str, WorkerHost] = {}  # in a worker: the host of the engine that has asked last


class ExecutorEngine(Engine):
    """Workers of an executor of `concurrent.futures`: ``ProcessPoolExecutor``, ``MPIPoolExecutor``, Dask, and others.

    An agent is at work wherever the executor sends it: it is built on a worker where it has not been, and put into its
    last state where it was elsewhere meanwhile. What a dead worker has not answered is requested again, where the
    executor goes on. The executor is not shut down.

    Parameters
    ----------
    executor : concurrent.futures.Executor
        Of processes; solvers are not made for threads. Its workers need this package in the same version.
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

    def __init__(self, executor: Executor | None, workers: int | None, *, deaths_allowed: int = 2) -> None:
        super().__init__(workers, deaths_allowed=deaths_allowed)
        self._executor: Any = executor
        self._submitted: dict[int, Future[Answer]] = {}
        self._serial = itertools.count()

    def open(self, places: int) -> None:
        """Begin with no agents."""
        self._key = uuid4().hex

    def submit(self, request: Request) -> Future[Answer]:
        """Have a request answered by a worker that the executor chooses."""
        try:
            future = self._executor.submit(_answer_in_worker, self._key, next(self._serial), request)
        except RuntimeError as error:  # of an executor that is broken, or was shut down
            raise EngineError(
                f"engine '{self.name}': the executor takes no more work ({type(error).__name__}: {error}). Make a new "
                "one; or take engine='process', which goes on when workers die."
            ) from error
        self._submitted[request.place] = future
        return future

    def close(self) -> None:
        """Take back requests that have not begun."""
        for future in self._submitted.values():
            future.cancel()
        self._submitted = {}


class DaskEngine(ExecutorEngine):
    """A cluster of Dask on this machine, of processes that listen on the loopback interface only; it ends with the
    engine. For other clusters there is `ExecutorEngine`.

    Parameters
    ----------
    workers, deaths_allowed
        As of `Engine`.

    Raises
    ------
    EngineError
        When Dask distributed is not installed, or `workers` is no such number.
    """

    name = "dask"

    def __init__(self, workers: int | None = None, *, deaths_allowed: int = 2) -> None:
        super().__init__(None, workers, deaths_allowed=deaths_allowed)
        if not distributed_available:
            raise EngineError(
                "engine 'dask': Dask distributed is not installed. Run: pip install 'pyrobocop_pyomo[dask]', or take "
                "engine='process', which needs no package."
            )
        self._opened = contextlib.ExitStack()

    def open(self, places: int) -> None:
        """Start the cluster."""
        check_protection()
        super().open(places)
        try:
            cluster = distributed.LocalCluster(
                n_workers=places,
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
        self._opened.enter_context(cluster)
        client = self._opened.enter_context(distributed.Client(cluster, set_as_default=False))
        self._executor = client.get_executor()

    def close(self) -> None:
        """End the cluster."""
        super().close()
        self._opened.close()


def dask_setup(worker: Any) -> None:
    """What every worker does when it starts: ignore Ctrl-C, which reaches the whole group of processes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _answer_in_worker(engine: str, serial: int, request: Request) -> Answer:
    """What a worker does; no two calls are alike, since Dask keeps what a call with the same arguments gave."""
    if engine not in _HOSTS:
        _HOSTS.clear()
        _HOSTS[engine] = WorkerHost()
    return _HOSTS[engine].answer(request)
