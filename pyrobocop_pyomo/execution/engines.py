"""Engines by their names, and `SerialEngine`, with which all others have to agree."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping

from pyrobocop_pyomo.errors import EngineError

from .dask_engine import DaskEngine
from .engine import Engine, Exchange
from .mpi_engine import MpiEngine
from .process_engine import ProcessEngine
from .worker_host import HostedSpec, Request, WorkerHost


class SerialEngine(Engine):
    """All agents in this process, one after the other.

    Needs nothing, starts at once, and any builder will do. Orders and reports are pickled here too, so that no array is
    shared by accident.
    """

    name = "serial"
    _keeps_states = False  # nobody is lost: this process is the coordinator's

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


ENGINES: dict[str, Callable[[], Engine]] = {
    "serial": SerialEngine,
    "process": ProcessEngine,
    "dask": DaskEngine,
    "mpi": MpiEngine,
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
        When there is no such engine, or its package is not installed; the message says what to install.
    """
    if isinstance(engine, Engine):
        return engine
    if engine not in ENGINES:
        raise EngineError(f"engine = {engine!r}; expected {', '.join(map(repr, ENGINES))}, or an Engine.")
    return ENGINES[engine]()
