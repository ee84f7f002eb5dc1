"""Template of an engine: where agents of teams and solvers of studies are at work.

    python -m tests.extension_templates.engine

is a worker: it answers requests that come through its standard input.
"""

import contextlib
import pickle
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from pyrobocop_pyomo.execution.engine import Engine
from pyrobocop_pyomo.execution.worker_host import Answer, Request, WorkerHost


class CommandEngine(Engine):
    """Workers that commands start, such as ``ssh node3 python -m engine``; requests and answers go through their pipes.

    Parameters
    ----------
    commands : sequence of sequence of str
        One for each worker.
    """

    name = "command"

    def __init__(self, commands: Sequence[Sequence[str]], *, deaths_allowed: int = 2) -> None:
        super().__init__(len(commands), deaths_allowed=deaths_allowed)
        self._commands = commands
        self._workers: list[subprocess.Popen[bytes]] = []

    def open(self, places: int) -> None:
        """Start as many workers as there are places."""
        self._threads = ThreadPoolExecutor(places)
        self._workers = [self._started(place) for place in range(places)]

    def _started(self, place: int) -> subprocess.Popen[bytes]:
        return subprocess.Popen(self._commands[place], stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def submit(self, request: Request) -> Future[Answer]:
        """Begin with a request; a thread waits for its answer, and raises something where the pipe has ended."""
        return self._threads.submit(_ask, self._workers[request.place], request)

    def replace_worker(self, place: int, error: Exception) -> str:
        """Start another worker in place of a lost one, and say how it ended."""
        code = _ended(self._workers[place])
        self._workers[place] = self._started(place)
        return f"{' '.join(self._commands[place])} ended with exit code {code}"

    def close(self) -> None:
        """End all workers."""
        while self._workers:
            _ended(self._workers.pop())


def _ask(worker: subprocess.Popen[bytes], request: Request) -> Answer:
    assert worker.stdin is not None
    assert worker.stdout is not None
    pickle.dump(request, worker.stdin)
    worker.stdin.flush()
    answer: Answer = pickle.load(worker.stdout)
    return answer


def _ended(worker: subprocess.Popen[bytes]) -> int:
    """End a worker, and tell its exit code, which is a negative number where a signal has ended it before."""
    with contextlib.suppress(BrokenPipeError), worker:  # it has not read all that it was sent
        worker.kill()
    return worker.wait()


def serve() -> None:
    """What a worker does all its life."""
    host, answers = WorkerHost(), sys.stdout.buffer
    sys.stdout = sys.stderr  # what a solver prints is no answer
    while True:
        pickle.dump(host.answer(pickle.load(sys.stdin.buffer)), answers)
        answers.flush()


if __name__ == "__main__":
    serve()
