"""`ProcessEngine`: processes on this machine, each connected by a pipe. Needs no package."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any

from pyrobocop_pyomo.errors import EngineError
from pyrobocop_pyomo.studies.worker_pool import available_cores

from .engine import Engine, Exchange
from .sending import build_request
from .worker_host import Answer, HostedSpec, Lost, Request, WorkerHost

# Agents solve side by side already: threads inside a solve would fight over the cores, and change the last digits.
SINGLE_THREADED = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
_READY = "ready"
_SECONDS_TO_END = 2.0


class ProcessEngine(Engine):
    """Processes on this machine, each connected by a pipe.

    Processes are spawned: a script that starts them protects its start with ``if __name__ == "__main__":``.

    Parameters
    ----------
    workers : int, optional
        Number of processes; agents are dealt out to them in turn. By default one for each agent, but no more than there
        are processors.
    snapshot_every, deaths_allowed : int
        As of `Engine`.

    Raises
    ------
    EngineError
        When `workers` is no such number.
    """

    name = "process"

    def __init__(self, workers: int | None = None, *, snapshot_every: int = 16, deaths_allowed: int = 2) -> None:
        super().__init__(snapshot_every=snapshot_every, deaths_allowed=deaths_allowed)
        if workers is not None and workers < 1:
            raise EngineError(f"engine 'process': workers = {workers!r}; expected at least 1.")
        self.workers = workers
        self._homes: dict[str, int] = {}
        self._processes: list[_Worker] = []

    @property
    def process_ids(self) -> dict[str, int]:
        """Of the process in which each agent lives."""
        return {name: self._processes[home].process.pid or 0 for name, home in self._homes.items()}

    def _build_request(self, spec: HostedSpec) -> Request:
        return build_request(spec, main_is_known=True)

    def _open(self, specs: Mapping[str, HostedSpec]) -> None:
        count = min(len(specs), self.workers or available_cores())
        self._homes = {name: i % count for i, name in enumerate(specs)}
        for number in range(count):
            self._processes.append(_Worker(number))
        for worker in self._processes:
            worker.wait_until_ready()

    def _exchange(self, requests: Sequence[Request]) -> Exchange:
        # A worker gets its next request once it has answered the last one: so neither end of a pipe ever waits for the
        # other with a full one, and when a worker ends, it is known at what.
        queues: dict[int, deque[Request]] = {}
        for request in requests:
            queues.setdefault(self._homes[request.agent], deque()).append(request)
        answers: dict[str, Answer] = {}
        lost: dict[str, Lost] = {}
        at_work: dict[Any, int] = {}
        for home in queues:
            at_work[self._processes[home].connection] = home
            self._processes[home].send(queues[home][0])
        while at_work:
            for connection in wait(list(at_work)):
                home = at_work[connection]
                queue, worker = queues[home], self._processes[home]
                answer = worker.receive()
                if answer is None:
                    reason, culprit = worker.how_it_ended(), queue[0].agent
                    of_home = [name for name, other in self._homes.items() if other == home]
                    lost.update({name: Lost(reason, at_work=name == culprit) for name in of_home})
                    del at_work[connection]
                    continue
                answers[queue.popleft().agent] = answer
                if queue:
                    worker.send(queue[0])
                else:
                    del at_work[connection]
        return answers, lost

    def _rehouse(self, agents: Sequence[str]) -> None:
        for home in sorted({self._homes[name] for name in agents}):
            if self._processes[home].has_ended:
                self._processes[home].end()
                self._processes[home] = _Worker(home)
                self._processes[home].wait_until_ready()

    def _close(self) -> None:
        processes, self._processes, self._homes = self._processes, [], {}
        for worker in processes:
            worker.ask_to_end()
        for worker in processes:
            worker.end()


class _Worker:
    """A process with a host, seen from the coordinator."""

    def __init__(self, number: int) -> None:
        if getattr(multiprocessing.current_process(), "_inheriting", False):
            raise EngineError(UNPROTECTED)
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.has_ended = False
        self._at_work = False
        self.process = context.Process(target=_serve, args=(theirs,), daemon=True, name=f"agents-{number}")
        # Threads are counted when NumPy is loaded, which is before `_serve` begins; so is Ctrl-C heard.
        with _environment(SINGLE_THREADED), _ctrl_c_unheard():
            self.process.start()
        theirs.close()  # so that the end of the process is the end of the pipe

    def wait_until_ready(self) -> None:
        try:
            assert self.connection.recv() == _READY
        except (EOFError, OSError):
            self.process.join(_SECONDS_TO_END)
            raise EngineError(
                f"engine 'process': a worker ended before it was ready (exit code {self.process.exitcode}). "
                f"{UNPROTECTED}"
            ) from None

    def send(self, request: Request) -> None:
        self._at_work = True
        with contextlib.suppress(OSError):  # of a worker that has ended: `receive` tells
            self.connection.send(request)

    def receive(self) -> Answer | None:
        """Its answer; None when it has ended."""
        try:
            answer: Answer = self.connection.recv()
        except (EOFError, OSError):
            self.has_ended = True
            return None
        self._at_work = False
        return answer

    def how_it_ended(self) -> str:
        self.process.join(_SECONDS_TO_END)
        code = self.process.exitcode
        if code is not None and code < 0:
            return f"process {self.process.pid} was ended by signal {-code} ({signal.Signals(-code).name})"
        return f"process {self.process.pid} ended with exit code {code}"

    def ask_to_end(self) -> None:
        if self._at_work:  # it would hear it after its solve only
            self.process.terminate()
        else:
            with contextlib.suppress(OSError):
                self.connection.send(None)

    def end(self) -> None:
        self.connection.close()
        self.process.join(_SECONDS_TO_END)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self.process.close()


UNPROTECTED = (
    "Processes are spawned and read the script again, so it has to protect what starts them: "
    "put the call under 'if __name__ == \"__main__\":'."
)


def _serve(connection: Connection) -> None:
    """What a worker does all its life."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group of processes; the coordinator ends us
    threading.Thread(target=_end_with_parent, daemon=True).start()
    host = WorkerHost()
    with contextlib.suppress(EOFError, OSError):
        connection.send(_READY)
        while (request := connection.recv()) is not None:
            connection.send(host.answer(request))


def _end_with_parent() -> None:
    """End at once where the coordinator has ended, also in the middle of a solve."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextlib.contextmanager
def _ctrl_c_unheard() -> Iterator[None]:
    """Let processes that start in here inherit that they ignore Ctrl-C."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def _environment(values: Mapping[str, str]) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
