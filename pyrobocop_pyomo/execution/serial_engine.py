"""`SerialEngine`: all agents in this process, one after the other. What the others have to agree with."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from .engine import Engine, Exchange
from .worker_host import HostedSpec, Request, WorkerHost


class SerialEngine(Engine):
    """All agents in this process, one after the other.

    Needs nothing, starts at once, and any builder will do. Orders and reports are pickled here too, so that no array is
    shared by accident, and bytes are counted as elsewhere.
    """

    name = "serial"
    _keeps_snapshots = False  # nobody is lost: this process is the coordinator's

    def __init__(self) -> None:
        super().__init__()
        self._host, self._submitted = WorkerHost(), deque[Request]()

    def submit(self, request: Request) -> None:
        """Let a request wait for its turn."""
        self._submitted.append(request)

    def wait(self, timeout: float | None = None) -> Exchange:
        """Answer the first request."""
        request = self._submitted.popleft()
        return {request.agent: self._host.answer(request)}, {}

    def _open(self, specs: Mapping[str, HostedSpec]) -> None:
        self._host, self._submitted = WorkerHost(specs), deque()

    def _close(self) -> None:
        self._host, self._submitted = WorkerHost(), deque()
