"""`SerialEngine`: everything in this process; all other engines have to agree with it."""

from __future__ import annotations

from concurrent.futures import Future

from .engine import Engine
from .worker_host import Answer, Request, WorkerHost


class SerialEngine(Engine):
    """All agents in this process, one after the other.

    Needs nothing, starts at once, and any builder will do. Orders and reports are pickled here too, so that no array is
    shared by accident.
    """

    name = "serial"
    _in_this_process = True

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
