"""Engines by their names, and `SerialEngine`, with which all others have to agree."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future

from pyrobocop_pyomo.errors import EngineError
from pyrobocop_pyomo.optional_imports import distributed_available, mpi_available

from .engine import Engine
from .executor_engine import dask_engine, mpi_engine
from .process_engine import ProcessEngine
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


ENGINES: dict[str, Callable[[], Engine]] = {
    "serial": SerialEngine,
    "process": ProcessEngine,
    "dask": dask_engine,
    "mpi": mpi_engine,
}
NEEDED = {"dask": ("Dask distributed", distributed_available), "mpi": ("mpi4py with an MPI library", mpi_available)}


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
    package, is_installed = NEEDED.get(engine, ("", True))
    if not is_installed:
        raise EngineError(
            f"engine {engine!r}: {package} is not installed. Run: pip install 'pyrobocop_pyomo[{engine}]', or take "
            "engine='process', which needs no package."
        )
    return ENGINES[engine]()
