"""`DaskEngine`: actors of Dask distributed, on this machine or on a cluster."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any
from uuid import uuid4

from pyrobocop_pyomo._version import __version__
from pyrobocop_pyomo.errors import EngineError
from pyrobocop_pyomo.optional_imports import distributed, distributed_available

from .engine import Engine, Exchange
from .sending import build_request
from .worker_host import Answer, HostedSpec, Lost, Request, WorkerHost
from .worker_process import UNPROTECTED, available_cores

_SECONDS_FOR_HOME = 30.0  # for a worker to appear, and for an actor to be made on it
_SECONDS_FOR_NEW_WORKER = 3.0  # a nanny starts a new worker in about two
_SECONDS_BETWEEN_LOOKS = 0.1
_SILENT = logging.CRITICAL


class DaskEngine(Engine):
    """Actors of Dask distributed, one for each agent.

    By default a cluster of processes on this machine that listens on the loopback interface only, and ends with the
    engine. Where a worker dies, its agents move to the one that replaces it, or to the others.

    Dask unpickles what it receives: whoever reaches its ports can run code there. Connect only to clusters in networks
    that you trust, or that are secured by TLS.

    Parameters
    ----------
    address : str, optional
        Of a running scheduler, such as ``"tcp://10.0.0.5:8786"``; its workers need this package in the same version.
    client : distributed.Client, optional
        A connection that exists already, for TLS or clusters of ``dask_jobqueue``; it is not closed.
    workers : int, optional
        Number of processes on this machine, where neither of these is given. By default one for each agent, but no more
        than there are processors.
    snapshot_every, deaths_allowed : int
        As of `Engine`.

    Raises
    ------
    EngineError
        When Dask distributed is not installed, or the arguments contradict each other.
    """

    name = "dask"

    def __init__(
        self,
        address: str | None = None,
        *,
        client: Any = None,
        workers: int | None = None,
        **of_every_engine: Any,
    ) -> None:
        super().__init__(**of_every_engine)
        if not distributed_available:
            raise EngineError(
                "engine 'dask': Dask distributed is not installed. Run: pip install 'pyrobocop_pyomo[dask]', or take "
                "engine='process', which needs no package."
            )
        if sum(given is not None for given in (address, client, workers)) > 1:
            raise EngineError(
                "engine 'dask': give an address, a client, or a number of workers here; not two of these."
            )
        if workers is not None and workers < 1:
            raise EngineError(f"engine 'dask': workers = {workers!r}; expected at least 1.")
        self.address = address
        self.workers = workers
        self._given_client = client
        self._client: Any = None
        self._cluster: Any = None
        self._actors: dict[str, Any] = {}
        self._futures: dict[str, Any] = {}  # Dask ends an actor whose future nobody holds
        self._homes: dict[str, str] = {}
        self._pending: dict[str, Any] = {}  # of agents that were asked: the future, or why there is none
        self._worker_count = 0

    @property
    def process_ids(self) -> dict[str, int]:
        """Of the process in which each agent lives, on the machine of its worker."""
        by_worker = self._client.run(os.getpid)
        return {name: by_worker[home] for name, home in self._homes.items() if home in by_worker}

    def _build_request(self, spec: HostedSpec) -> Request:
        return build_request(spec, main_is_known=self.address is None)

    def _open(self, specs: Mapping[str, HostedSpec]) -> None:
        self._find_client()
        if self._client is None:
            self._cluster = self._local_cluster(self.places(len(specs)))
            self._client = distributed.Client(self._cluster, set_as_default=False)
        workers = self._workers(deadline=time.monotonic() + _SECONDS_FOR_HOME)
        self._worker_count = len(workers)
        self._check_versions()
        self._make_actors({name: workers[i % len(workers)] for i, name in enumerate(specs)})

    def _find_client(self) -> None:
        """Take the client that was given, or connect to the address that was."""
        if self._given_client is not None:
            self._client = self._given_client
        elif self.address is not None and self._client is None:
            self._client = self._connect(self.address)

    def places(self, most: int) -> int:
        """How many agents can solve side by side: one on each worker."""
        self._find_client()
        if self._client is None:
            return min(most, self.workers or available_cores())
        return min(most, len(self._workers(deadline=time.monotonic() + _SECONDS_FOR_HOME)))

    def _connect(self, address: str) -> Any:
        try:
            return distributed.Client(address, set_as_default=False, timeout=_SECONDS_FOR_HOME)
        except (OSError, ValueError, TypeError) as error:
            raise EngineError(f"engine 'dask': no scheduler answers at {address!r}: {error}") from error

    def _local_cluster(self, count: int) -> Any:
        if getattr(multiprocessing.current_process(), "_inheriting", False):
            raise EngineError(UNPROTECTED)
        try:
            return distributed.LocalCluster(
                n_workers=count,
                processes=True,
                threads_per_worker=1,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",  # none would take a port that another cluster may have
                silence_logs=_SILENT,
                preload=["pyrobocop_pyomo.execution.dask_worker"],
            )
        except (RuntimeError, OSError, TimeoutError) as error:
            raise EngineError(f"engine 'dask': no workers could be started here: {error}. {UNPROTECTED}") from error

    def _workers(self, deadline: float, wanted: int = 1, without: frozenset[str] = frozenset()) -> list[str]:
        """Addresses of the workers there are; waits for so many of them, and for one if need be."""
        while True:
            found = sorted(set(self._client.nthreads()) - without)
            if len(found) >= wanted or (found and time.monotonic() > deadline):
                return found
            if time.monotonic() > deadline + _SECONDS_FOR_HOME:
                raise EngineError("engine 'dask': the cluster has no worker. Start one: dask worker ADDRESS.")
            time.sleep(0.05)

    def _check_versions(self) -> None:
        try:
            versions = self._client.run(_installed_version)
        except Exception as error:  # what a worker without this package raises is up to Dask
            raise EngineError(f"engine 'dask': not every worker has pyrobocop_pyomo {__version__}: {error}") from error
        for worker, version in versions.items():
            if version != __version__:
                raise EngineError(
                    f"engine 'dask': worker {worker} has pyrobocop_pyomo {version}, this process has {__version__}. "
                    "Install the same version everywhere."
                )

    def _make_actors(self, homes: Mapping[str, str]) -> None:
        futures = {
            name: self._client.submit(
                WorkerHost,
                actor=True,
                workers=[home],
                allow_other_workers=False,
                pure=False,
                key=f"agent-{name}-{uuid4().hex}",
            )
            for name, home in homes.items()
        }
        self._futures.update(futures)
        for name, future in futures.items():
            self._homes[name] = homes[name]
            try:
                self._actors[name] = future.result(timeout=_SECONDS_FOR_HOME)
            except Exception:  # its worker has died meanwhile; the next request finds out
                self._actors.pop(name, None)

    def submit(self, request: Request) -> None:
        """Send a request to its agent's worker."""
        with self._client.as_current():  # where an actor looks for its client when it is first called
            try:
                self._pending[request.agent] = self._actors[request.agent].answer(request)
            except Exception as error:  # a method of a lost actor cannot be called; the type is up to Dask
                self._pending[request.agent] = error

    def wait(self, timeout: float | None = None) -> Exchange:
        """Answers and lost workers: the first that come, and none where `timeout` seconds pass before."""
        end = None if timeout is None else time.monotonic() + timeout
        answers: dict[str, Answer] = {}
        lost: dict[str, Lost] = {}
        while self._pending and not answers and not lost:
            self._look(answers, lost)
            if end is not None and time.monotonic() > end:
                break
        return answers, lost

    def _look(self, answers: dict[str, Answer], lost: dict[str, Lost]) -> None:
        """Take what has come; if there is nothing, wait a moment for the first agent, and look who is still there.

        A host answers whatever its agent raises, so every exception here is the loss of a worker. Agents of one worker
        are solved in the order of their requests: the first one without an answer was at work.
        """
        first = next(iter(self._pending))
        for name, future in list(self._pending.items()):
            if name in lost:
                continue
            try:
                if isinstance(future, Exception):
                    raise future
                if name == first or future.done():
                    answers[name] = future.result(timeout=_SECONDS_BETWEEN_LOOKS)
                    del self._pending[name]
            except (TimeoutError, multiprocessing.TimeoutError):
                continue
            except Exception as error:
                self._lose_home_of(name, error, lost)
        if not answers and not lost:
            # A worker that is gone, or an actor: of some losses Dask does not tell who waits.
            living = self._client.nthreads()
            for name in list(self._pending):
                if name in self._pending and (
                    self._homes[name] not in living or self._futures[name].status != "finished"
                ):
                    self._lose_home_of(name, TimeoutError("no answer"), lost)

    def end_silent_workers(self) -> None:
        """Count the workers that owe an answer as lost: a stopped one keeps its connection for minutes."""
        for name in self._pending:
            self._pending[name] = RuntimeError(f"no answer within {self.answer_within:g} s")

    def _lose_home_of(self, name: str, error: Exception, lost: dict[str, Lost]) -> None:
        home = self._homes[name]
        reason = f"worker {home} was lost ({type(error).__name__}: {error})"
        for other in [other for other in self._homes if self._homes[other] == home]:
            lost.setdefault(other, Lost(reason, at_work=other == name))
            self._pending.pop(other, None)

    def respawn(self, agents: Sequence[str]) -> None:
        """Make actors on workers that live, new ones if they come soon."""
        dead = frozenset(self._homes[name] for name in agents)
        for name in agents:
            self._actors.pop(name, None)
            self._futures.pop(name, None)
        wanted = self._worker_count
        workers = self._workers(time.monotonic() + _SECONDS_FOR_NEW_WORKER, wanted, without=dead)
        load = Counter(dict.fromkeys(workers, 0))
        load.update(home for name, home in self._homes.items() if home in load and name not in agents)
        homes = {}
        for name in agents:
            homes[name] = min(load, key=lambda worker: (load[worker], worker))
            load[homes[name]] += 1
        self._make_actors(homes)

    def _close(self) -> None:
        self._actors, self._futures, self._homes, self._pending = {}, {}, {}, {}
        client, cluster, self._client, self._cluster = self._client, self._cluster, None, None
        if client is not None and client is not self._given_client:
            with contextlib.suppress(Exception):
                client.close()
        if cluster is not None:
            with contextlib.suppress(Exception):
                cluster.close()


def _installed_version() -> str:
    return __version__
