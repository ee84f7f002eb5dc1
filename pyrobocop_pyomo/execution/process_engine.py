"""`ProcessEngine`: processes on this machine, each connected by a pipe. Needs no package."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator, Mapping
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from typing import Any

from pyrobocop_pyomo.errors import EngineError

from .homes import AnswerOrEnd, EngineWithHomes, Home
from .worker_host import Answer, Request, WorkerHost

# One thread each: the processes are the parallelism, and pools of threads would fight over the cores, and change the
# last digits. Libraries read these when they are loaded. What the user has set stays: it is also set in this process.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
UNPROTECTED = (
    "Processes read the script again, so it has to protect what starts them: "
    "put the call under 'if __name__ == \"__main__\":'."
)
_PRELOADED = ["pyrobocop_pyomo", "pyrobocop_pyomo.execution.worker_imports", __name__]
_READY = "ready"
_SECONDS_TO_END = 2.0


class WorkerProcess(Home):
    """A process with a host, connected by a pipe.

    Parameters
    ----------
    number : int
        For its name.

    Attributes
    ----------
    connection : Connection

    Raises
    ------
    EngineError
        In a script that does not protect its start.
    """

    def __init__(self, number: int) -> None:
        if getattr(multiprocessing.current_process(), "_inheriting", False):
            raise EngineError(UNPROTECTED)
        super().__init__()
        with _inherited_by_processes():
            context = _process_context()
            self.connection, theirs = context.Pipe()
            environment = {**ONE_THREAD, **os.environ}
            self.process = context.Process(
                target=_serve, args=(theirs, environment), daemon=True, name=f"worker-{number}"
            )
            self.process.start()
        theirs.close()  # so that the end of the process is the end of the pipe

    def wait_until_ready(self) -> None:
        """Wait until it takes requests.

        Raises
        ------
        EngineError
            When it has ended before.
        """
        try:
            assert self.connection.recv() == _READY
        except (EOFError, OSError):
            self.process.join(_SECONDS_TO_END)
            raise EngineError(
                f"engine 'process': a worker ended before it was ready (exit code {self.process.exitcode}). "
                f"{UNPROTECTED}"
            ) from None

    def ask(self, request: Request) -> AnswerOrEnd:
        """Have a request answered; where the process has ended, gives how, with its exit code or signal."""
        with contextlib.suppress(EOFError, OSError):
            self.connection.send(request)
            answer: Answer = self.connection.recv()
            return answer
        self.process.join(_SECONDS_TO_END)
        code = self.process.exitcode
        if code is not None and code < 0:
            return f"process {self.process.pid} was ended by signal {-code} ({signal.Signals(-code).name})"
        return f"process {self.process.pid} ended with exit code {code}"

    def kill(self) -> None:
        """End the process, whatever it does."""
        self.process.kill()

    def end(self) -> None:
        """Wait until it has ended, which it does with the connection."""
        super().end()
        self.connection.close()
        self.process.join(_SECONDS_TO_END)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self.process.close()


class ProcessEngine(EngineWithHomes[WorkerProcess]):
    """Processes on this machine, each connected by a pipe.

    They are no copies of this process: a script that starts them protects its start with
    ``if __name__ == "__main__":``.

    Parameters
    ----------
    workers : int, optional
        Number of processes; agents are dealt out to them in turn. By default one for each agent, but no more than there
        are processors.
    deaths_allowed, answer_within
        As of `Engine`.

    Raises
    ------
    EngineError
        When `workers` is no such number.
    """

    name = "process"

    def _make_home(self, number: int) -> WorkerProcess:
        return WorkerProcess(number)


def _process_context() -> Any:
    """How processes are started: never as a copy of this one, with its threads and the state of its solvers.

    On Linux they are copies of a server that has imported this package and done nothing else. It lives as long as this
    process, so that all processes but the first start in hundredths of a second. Elsewhere each imports by itself.
    """
    if not sys.platform.startswith("linux"):
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(_PRELOADED)
    forkserver.ensure_running()
    return context


def _serve(connection: Connection, environment: Mapping[str, str]) -> None:
    """What a worker does all its life."""
    # The server was started with the environment of another time.
    for name in set(os.environ) - set(environment):
        del os.environ[name]
    os.environ.update(environment)
    # On a terminal Ctrl-C reaches every process; here it means something to a running solve only, which puts its own
    # handler in place of this one.
    signal.signal(signal.SIGINT, lambda number, frame: None)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    host = WorkerHost()
    with contextlib.suppress(EOFError, OSError):
        connection.send(_READY)
        while True:
            connection.send(host.answer(connection.recv()))


def _end_with_parent() -> None:
    """End at once where the coordinator has ended, also in the middle of a solve."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextlib.contextmanager
def _inherited_by_processes() -> Iterator[None]:
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
