"""`ProcessEngine`: processes on this machine, each connected by a pipe. Needs no package."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from multiprocessing.connection import Connection
from typing import Any

from pyrobocop_pyomo.errors import EngineError

from .engine import Engine
from .worker_host import Answer, Request, WorkerHost

# One thread each: the processes are the parallelism, and pools of threads would fight over the cores, and change the
# last digits. Libraries read these when they are loaded. What the user has set stays: it is also set in this process.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
UNPROTECTED = (
    "Processes read the script again, so it has to protect what starts them: "
    "put the call under 'if __name__ == \"__main__\":'."
)
_SECONDS_TO_END = 2.0


class WorkerProcess:
    """A process with a host, connected by a pipe.

    Parameters
    ----------
    number : int
        For its name.

    Raises
    ------
    EngineError
        In a script that does not protect its start.
    """

    def __init__(self, number: int) -> None:
        check_protection()
        with inherited_by_processes():
            context = _process_context()
            self._connection, theirs = context.Pipe()
            self._process = context.Process(target=_serve, args=(theirs, dict(os.environ)), name=f"worker-{number}")
            self._process.daemon = True
            self._process.start()
        theirs.close()  # so that the end of the process is the end of the pipe

    def wait_until_ready(self) -> None:
        """Wait until it takes requests.

        Raises
        ------
        EngineError
            When it has ended before.
        """
        try:
            self._connection.recv()
        except (EOFError, OSError):
            ended = f"a worker ended before it was ready: {self._end_in_words()}"
            raise EngineError(f"engine 'process': {ended}. {UNPROTECTED}") from None

    def answer(self, request: Request, limit: float) -> Answer:
        """Have a request answered, in so many seconds.

        Raises
        ------
        ConnectionError
            When the process has ended, or an agent does not answer; it says so in words.
        """
        silent = threading.Timer(limit, self._process.kill)
        silent.start()
        try:
            self._connection.send(request)
            answer: Answer = self._connection.recv()
            return answer
        except (EOFError, OSError):
            late = "" if silent.is_alive() else f"no answer within {limit} s: "
            raise ConnectionError(late + self._end_in_words()) from None
        finally:
            silent.cancel()

    def _end_in_words(self) -> str:
        self._process.join(_SECONDS_TO_END)
        code = self._process.exitcode
        if code is not None and code < 0:
            return f"process {self._process.pid} was ended by signal {-code} ({signal.Signals(-code).name})"
        return f"process {self._process.pid} ended with exit code {code}"

    def kill(self) -> None:
        """End it, whatever it does; who waits for an answer is told."""
        self._process.kill()
        self._process.join()


class ProcessEngine(Engine):
    """Processes on this machine, each connected by a pipe.

    They are no copies of this process: a script that starts them protects its start with
    ``if __name__ == "__main__":``.

    Parameters
    ----------
    workers : int, optional
        Number of processes. By default one for each agent, but no more than there are processors.
    deaths_allowed
        As of `Engine`.
    answer_within : float
        Seconds after which a process counts as dead whose agent has not answered.

    Raises
    ------
    EngineError
        When one of these is no such number.
    """

    name = "process"

    def __init__(self, workers: int | None = None, *, deaths_allowed: int = 2, answer_within: float = 600.0) -> None:
        super().__init__(workers, deaths_allowed=deaths_allowed)
        if not answer_within > 0:
            raise EngineError(f"engine 'process': answer_within = {answer_within!r}; expected a positive number.")
        self.answer_within = answer_within
        self._processes: list[WorkerProcess] = []

    def open(self, places: int) -> None:
        """Start processes, side by side."""
        self._threads = ThreadPoolExecutor(places)  # each waits for an answer, so that no pipe is ever full
        for place in range(places):
            self._processes.append(WorkerProcess(place))
        for process in self._processes:
            process.wait_until_ready()

    def submit(self, request: Request) -> Future[Answer]:
        """Have a request answered by the process of its place."""
        # Agents are those that have a state; what a study does may take as long as it likes.
        limit = self.answer_within if request.with_state else threading.TIMEOUT_MAX
        return self._threads.submit(self._processes[request.place].answer, request, limit)

    def replace_worker(self, place: int, error: Exception) -> str:
        """Start another process."""
        self._processes[place].kill()
        self._processes[place] = WorkerProcess(place)
        self._processes[place].wait_until_ready()
        return str(error)

    def close(self) -> None:
        """End all processes."""
        while self._processes:
            self._processes.pop().kill()


def check_protection() -> None:
    """Refuse to start processes in one that is just reading the script again.

    Raises
    ------
    EngineError
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise EngineError(UNPROTECTED)


def _process_context() -> Any:
    """How processes are started: never as a copy of this one, with its threads and the state of its solvers.

    On Linux they are copies of a server that has imported this package and done nothing else. It lives as long as this
    process, so that all processes but the first start in hundredths of a second. Elsewhere each imports by itself.
    """
    if not sys.platform.startswith("linux"):
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["pyrobocop_pyomo", "pyrobocop_pyomo.execution.worker_imports", __name__])
    return context


def _serve(connection: Connection, environment: Mapping[str, str]) -> None:
    """What a worker does all its life."""
    # The server was started with the environment of another time.
    os.environ.clear()
    os.environ.update(environment)
    # On a terminal Ctrl-C reaches every process; here it means something to a running solve only, which puts its own
    # handler in place of this one.
    signal.signal(signal.SIGINT, lambda number, frame: None)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    host = WorkerHost()
    with contextlib.suppress(EOFError, OSError):
        connection.send("ready")
        while True:
            connection.send(host.answer(connection.recv()))


def _end_with_parent() -> None:
    """End at once where the coordinator has ended, also in the middle of a solve."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextlib.contextmanager
def inherited_by_processes() -> Iterator[None]:
    """Let processes that start in here, and what a server that does so starts later, ignore Ctrl-C and have one thread.

    Signals are the main thread's: of another one processes inherit what they are.
    """
    is_main = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGINT, signal.SIG_IGN) if is_main else None
    added = [name for name in ONE_THREAD if name not in os.environ]
    os.environ.update({name: ONE_THREAD[name] for name in added})
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]
        if is_main:
            signal.signal(signal.SIGINT, before)
