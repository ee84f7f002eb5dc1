"""`DaskEngine`: actors of Dask distributed, on this machine or on a cluster."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import time
from collections import Counter
from collections.abc import Collection, Mapping
from typing import Any
from uuid import uuid4

from pyrobocop_pyomo._version import __version__
from pyrobocop_pyomo.errors import EngineError
from pyrobocop_pyomo.optional_imports import distributed, distributed_available

from .homes import AnswerOrEnd, EngineWithHomes, Home
from .process_engine import UNPROTECTED
from .worker_host import Answer, HostedSpec, Request, WorkerHost

_SECONDS_FOR_HOME = 30.0  # for a worker to appear, and for an actor to be made on it


class ActorHome(Home):
    """A host that is an actor on a worker of Dask.

    A host answers whatever its agents raise, so every exception here is the loss of the worker; its type is up to Dask.

    Parameters
    ----------
    client : distributed.Client
    address : str
        Of the worker.
    """

    def __init__(self, client: Any, address: str) -> None:
        super().__init__()
        self.address, self._client = address, client
        # Dask ends an actor whose future nobody holds.
        self._made = client.submit(
            WorkerHost,
            actor=True,
            workers=[address],
            allow_other_workers=False,
            pure=False,
            key=f"agents-{uuid4().hex}",
        )
        self._actor: Any = None
        self._given_up = False

    def wait_until_ready(self) -> None:
        """Wait for the actor; where its worker has died meanwhile, the first request finds out."""
        with contextlib.suppress(Exception):
            self._actor = self._made.result(timeout=_SECONDS_FOR_HOME)

    def ask(self, request: Request) -> AnswerOrEnd:
        """Have a request answered; where the worker was lost, gives what Dask said. It tells nobody of some losses."""
        try:
            with self._client.as_current():  # where an actor looks for its client when it is first called
                reply = self._actor.answer(request)
            while True:
                with contextlib.suppress(TimeoutError, distributed.TimeoutError):
                    answer: Answer = reply.result(timeout=0.1)
                    return answer
                lives = self.address in self._client.nthreads() and self._made.status == "finished"
                if self._given_up or not lives:
                    raise TimeoutError("no answer")
        except Exception as error:
            return f"worker {self.address} was lost ({type(error).__name__}: {error})"

    def kill(self) -> None:
        """Count it as lost: a stopped worker keeps its connection for minutes."""
        self._given_up = True


class DaskEngine(EngineWithHomes[ActorHome]):
    """Actors of Dask distributed, one for each worker.

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
    deaths_allowed, answer_within
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
        super().__init__(workers, **of_every_engine)
        if not distributed_available:
            raise EngineError(
                "engine 'dask': Dask distributed is not installed. Run: pip install 'pyrobocop_pyomo[dask]', or take "
                "engine='process', which needs no package."
            )
        if sum(given is not None for given in (address, client, workers)) > 1:
            raise EngineError(
                "engine 'dask': give an address, a client, or a number of workers here; not two of these."
            )
        self.address = address
        self._given_client = self._client = client
        self._cluster: Any = None

    def _open(self, specs: Mapping[str, HostedSpec]) -> None:
        count = self.places(len(specs))
        if self._client is None:
            self._cluster = self._local_cluster(count)
            self._client = distributed.Client(self._cluster, set_as_default=False)
        self._check_versions()
        super()._open(specs)

    def places(self, most: int) -> int:
        """How many agents can solve side by side: one on each worker; connects to the address that was given."""
        if self.address is not None and self._client is None:
            try:
                self._client = distributed.Client(self.address, set_as_default=False, timeout=_SECONDS_FOR_HOME)
            except (OSError, ValueError, TypeError) as error:
                raise EngineError(f"engine 'dask': no scheduler answers at {self.address!r}: {error}") from error
        if self._client is None:
            return super().places(most)
        return min(most, len(self._workers(_SECONDS_FOR_HOME)))

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
                silence_logs=logging.CRITICAL,
                preload=["pyrobocop_pyomo.execution.dask_worker"],
            )
        except (RuntimeError, OSError, TimeoutError) as error:
            raise EngineError(f"engine 'dask': no workers could be started here: {error}. {UNPROTECTED}") from error

    def _workers(self, seconds: float, wanted: int = 1, without: Collection[str] = ()) -> list[str]:
        """Addresses of the workers there are; waits so long for so many of them, and longer for one if need be."""
        started = time.monotonic()
        while True:
            found = sorted(set(self._client.nthreads()).difference(without))
            waited = time.monotonic() - started
            if len(found) >= wanted or (found and waited > seconds):
                return found
            if waited > seconds + _SECONDS_FOR_HOME:
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

    def _make_home(self, number: int) -> ActorHome:
        """An actor on the worker with the fewest; in place of a worker that was lost a new one may come soon."""
        homes = [home for other, home in self._homes.items() if other != number]
        lost = {home.address for home in self._homes.values() if home.has_ended}
        workers = self._workers(3.0, max(1, len(self._homes)), without=lost)  # a nanny starts a new worker in about two
        load = Counter(home.address for home in homes)
        return ActorHome(self._client, min(workers, key=lambda worker: (load[worker], worker)))

    def _close(self) -> None:
        super()._close()
        opened, self._client, self._cluster = [self._client, self._cluster], self._given_client, None
        for each in opened:
            if each is not None and each is not self._given_client:
                with contextlib.suppress(Exception):
                    each.close()


def _installed_version() -> str:
    return __version__
